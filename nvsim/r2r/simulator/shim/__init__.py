"""The folder that stands on PYTHONPATH of programs that import MatterSim: they get our simulator under that name."""
