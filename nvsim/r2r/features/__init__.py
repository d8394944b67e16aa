"""Extracts features of the 36 views and the candidates of every viewpoint, in the file layouts that agents read."""
