"""Benchmarks of speed and memory, one file per subject. Only the commands `nvsim bench` use this package."""
