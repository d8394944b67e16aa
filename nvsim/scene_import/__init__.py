"""Turns the Gaussians of any splat file into a scene for exploration: up direction, unit, storeys, and free floor.
Independent of images and projects."""
