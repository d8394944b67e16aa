"""Generates instructions from the geometry of paths, and checks that a follower finds the path from them.

Works offline and without a network."""
