"""Poses, intrinsics, lenses, and the floor as a surface: plain NumPy geometry, independent of images and formats."""
