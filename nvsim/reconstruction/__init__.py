"""A video becomes a capture: its frames, their camera poses, points, and a report. Knows no project."""
