"""Paths through scans, with instructions: how they are found, spread, split, and written as R2R's files. Knows no agent
and no image."""
