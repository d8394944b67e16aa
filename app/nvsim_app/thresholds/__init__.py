"""Thresholds that are tried on the whole graph: sliders, a preview of the changed edges, and the edit itself."""
