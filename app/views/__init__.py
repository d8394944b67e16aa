"""Map and 3D view, how one moves in them, and the surface that modes work on. Knows no panel."""
