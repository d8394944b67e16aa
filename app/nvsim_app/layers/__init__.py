"""The layers of the 3D view. A layer paints data of the document and does not modify it. The user sets
its visibility and opacity in the layers panel."""
