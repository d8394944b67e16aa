"""Metrics of views, floor masks, depth, normals, and graphs against ground truth. Most have one function and one
command."""
