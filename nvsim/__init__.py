"""NVSim: from a posed walk through a building to a vision-and-language navigation simulator."""

from nvsim.kernel_threads import choose

__version__ = "0.1.0"

choose()  # whoever imports any part of the library comes by here first
