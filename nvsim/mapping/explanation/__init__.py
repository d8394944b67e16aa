"""Explanations: why a corridor is open, why two viewpoints have an edge, and why a graph is poor."""
