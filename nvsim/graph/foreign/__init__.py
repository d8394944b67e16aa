"""Connectivity files of other programs, edited in place: what no edit touched is written back to the byte.

The format and its traps: Matterport3DSimulator, connectivity/README.md. Knows no window and no project.
"""

from nvsim.graph.foreign.beside import Beside, look_beside
from nvsim.graph.foreign.file import ForeignFile, connectivity_files
from nvsim.graph.foreign.original import islands, words_of_saving

__all__ = ["Beside", "ForeignFile", "connectivity_files", "islands", "look_beside", "words_of_saving"]
