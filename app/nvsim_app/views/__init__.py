"""The map and the 3D view, their navigation, and the interface that editing modes use. Independent of panels."""
