"""Thresholds tried out on the whole graph: sliders, what would appear and disappear, and the step that applies it."""
