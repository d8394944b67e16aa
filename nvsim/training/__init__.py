"""Training of submaps: losses, densification, robust masks, schedule, checkpoints, trainer. Does not use project
files."""
