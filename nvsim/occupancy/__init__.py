"""2D maps of free, occupied and unknown: read, written, built; paths and visibility on them. Knows no graph."""
