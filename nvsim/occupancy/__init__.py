"""2D maps of free, occupied and unknown: read, written, built from clouds; paths and visibility on them. Knows no graph."""
