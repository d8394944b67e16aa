"""2D occupancy maps (free, occupied, unknown): read, write, and build them; find paths and visibility on them."""
