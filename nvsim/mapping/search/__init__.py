"""The search: corridors are decided one by one, and the graph grows along the lattice and the trajectory."""
