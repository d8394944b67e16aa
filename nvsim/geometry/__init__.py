"""Poses, intrinsics, lenses, and the floor as a surface: plain geometry in numpy. Knows no files and no images."""
