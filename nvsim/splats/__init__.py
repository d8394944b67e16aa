"""Gaussians, background, floor texture, submap models, the scene model (which submap answers where), and their files.

Knows no rasteriser and imports no torch."""
