"""Edit connectivity files of other programs in place. Text that no edit touched is written back byte for byte.

Format and pitfalls: Matterport3DSimulator, connectivity/README.md. This package does not depend on a window or a
project.
"""

from nvsim.graph.foreign.file import ForeignFile, connectivity_files
from nvsim.graph.foreign.neighboring_files import FilesBeside, find_files_beside
from nvsim.graph.foreign.notes import disconnected_warning, saving_message

__all__ = [
    "FilesBeside",
    "ForeignFile",
    "connectivity_files",
    "disconnected_warning",
    "find_files_beside",
    "saving_message",
]
