"""Reads an occupancy map in a side process. Reading needs OpenCV, and Python holds its global lock while it loads the
library, which would block the window for 100 ms or more. Does not use Qt."""

from __future__ import annotations

from pathlib import Path

from app.processes.child import Child, Program
from app.processes.serving import Requests
from nvsim.occupancy.types import OccupancyMap

_MEMORY = 4 << 30  # bytes; a map of a square kilometre needs 0.4 GB


def start_reading(path: Path) -> Child:
    """Starts to read the map of a project folder or a map file. The result is an OccupancyMap, None if a project has no
    map."""
    return Child(_PROGRAM, path)


def _read(requests: Requests, path: Path) -> OccupancyMap | None:
    if path.is_file():
        from nvsim.occupancy.read import read_map

        return read_map(path)
    from nvsim.project.occupancy_maps import occupancy_of
    from nvsim.project.project import Project

    with Project.open(path) as project:
        return occupancy_of(project)


_PROGRAM = Program(
    _read,
    "occupancy",
    "The occupancy map cannot be read",
    "close other programs and open the project again",
    memory=_MEMORY,
)
