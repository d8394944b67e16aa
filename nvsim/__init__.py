"""NVSim builds vision-and-language navigation simulators from images with camera poses."""

from nvsim import kernel_folder, kernel_threads

__version__ = "0.1.0"

# Set both before numba is imported. Every import of the library begins here.
kernel_threads.choose()
kernel_folder.choose()
