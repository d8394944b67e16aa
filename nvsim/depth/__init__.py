"""Depth of every image from its posed neighbours, on the CPU, and the cloud that the depth maps make together."""
