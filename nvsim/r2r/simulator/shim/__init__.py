"""The folder for the PYTHONPATH of programs that import MatterSim: they get NVSim's simulator under that name."""
