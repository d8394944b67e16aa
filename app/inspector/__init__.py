"""The viewpoint inspector: what was measured around a viewpoint, in the panorama that it was measured in."""
