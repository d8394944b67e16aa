"""NVSim: from a posed walk through a building to a vision-and-language navigation simulator."""

from nvsim import kernel_folder, kernel_threads

__version__ = "0.1.0"

# Both have to be settled before numba is imported, and every import of the library begins here.
kernel_threads.choose()
kernel_folder.choose()
