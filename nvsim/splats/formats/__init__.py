"""Gaussians in the file formats of other programs. Knows no submap model: only Gaussians and how they are drawn."""
