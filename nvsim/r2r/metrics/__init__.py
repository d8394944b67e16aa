"""Computes the metrics of R2R's evaluation for trajectories, and reads and writes trajectory files."""
