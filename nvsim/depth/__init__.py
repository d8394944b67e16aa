"""Estimate the depth of every image from neighboring images with poses, on the CPU, and fuse it to a point cloud."""
