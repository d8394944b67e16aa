"""Losses, densification, robust mask, schedule, checkpoint, trainer. Knows no projects on disk."""
