"""Densification strategies, one per file: they divide, clone, move, and remove Gaussians during training. They use
Gaussians and their statistics, but no image, loss, or optimizer."""
