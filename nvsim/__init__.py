"""NVSim: from a posed walk through a building to a vision-and-language navigation simulator."""

__version__ = "0.1.0"
