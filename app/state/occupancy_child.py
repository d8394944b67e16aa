"""Reads an occupancy map in a child process. Reading needs OpenCV, and Python holds its global lock while it loads the
library, which would block the window for 100 ms or more. Does not use Qt."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np

from app.state.child import Child, answer
from nvsim.occupancy.types import OccupancyMap


class OccupancyChild:
    """Reads the map of a project folder or a map file. The process starts immediately."""

    def __init__(self, path: Path) -> None:
        """Raises InputError if no process can be started."""
        then = "close other programs and open the project again"
        self._child = Child("app.state.occupancy_child", path, "The occupancy map cannot be read", then)

    def result(self) -> OccupancyMap | None:
        """Waits for the map; None if a project has no map, or after `kill`. Raises InputError with the reason if
        reading fails."""
        found = self._child.output()
        if not found:
            return None
        with np.load(io.BytesIO(found)) as data:
            x, y = data["origin"].tolist()
            notes = tuple(map(str, data["notes"]))
            return OccupancyMap(data["cells"], float(data["resolution"]), (x, y), notes)

    def kill(self) -> None:
        """Ends the process. Can be called from any thread, also after the end."""
        self._child.kill()


def _read(path: Path) -> OccupancyMap | None:
    if path.is_file():
        from nvsim.occupancy.read import read_map

        return read_map(path)
    from nvsim.project.occupancy_maps import occupancy_of
    from nvsim.project.project import Project

    with Project.open(path) as project:
        return occupancy_of(project)


def _answer(path: Path) -> bytes:
    """The encoded map, empty if there is none."""
    found, written = _read(path), io.BytesIO()
    if found is not None:
        notes = np.array(found.notes, np.str_)
        np.savez(written, cells=found.cells, resolution=found.resolution, origin=found.origin, notes=notes)
    return written.getvalue()


if __name__ == "__main__":
    sys.exit(answer(_answer))
