"""Putting thousands of things on the screen: primitives, graph ink, picking, tones, cameras. Knows no document."""
