"""Readers of posed walks into one typed Capture, the data check, and the built-in building. Knows no submaps, no models."""
