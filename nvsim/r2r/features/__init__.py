"""Features of the 36 views and the candidates of every viewpoint, in the layouts that agents read."""
