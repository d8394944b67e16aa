"""Data types of trained submap models: Gaussians, background, floor texture, the scene model (which selects the submap
for a camera position), and their files.

This package does not depend on a rasterizer or on torch."""
