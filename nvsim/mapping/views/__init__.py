"""The views that corridors are read from, and what they show: a view of the floor, the pixels of the floor, the
photographed share of a viewpoint."""
