"""Readers of posed walks into one typed Capture, the data check, the built-in building. Knows no submaps, no models."""
