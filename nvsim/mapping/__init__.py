"""The map builder: corridors, criteria, and the breadth-first search of the paper (Algorithm 1). This package reads no
files."""
