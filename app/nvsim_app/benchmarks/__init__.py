"""Benchmarks of the window: start time, frame rate, event loop gaps, and edits. Only the start code uses them."""
