"""Cutting the trajectory into overlapping submaps (paper section III-B). Knows positions, no images."""
