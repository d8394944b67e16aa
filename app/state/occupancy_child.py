"""Reads an occupancy map in a process of its own: that takes OpenCV, and Python loads a library with its global lock
held, so that a window that did it in a thread would stand still for 100 ms and more. Knows no Qt."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.occupancy.types import OccupancyMap

NICE = 5  # the window comes first


class OccupancyChild:
    """One reading, which begins at once: of a project's folder, or of a map's file."""

    def __init__(self, path: Path) -> None:
        """Raises InputError when no process can be started."""
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        command = [sys.executable, "-P", "-m", "app.state.occupancy_child", str(path)]
        pipe = subprocess.PIPE
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, env=environment
            )
        except OSError as error:
            raise InputError(
                f"The occupancy map cannot be read: {error}; close other programs and open the project again."
            ) from error
        self._killed = False

    def result(self) -> OccupancyMap | None:
        """Waits for it; None where a project has no map, or after `kill`. Raises InputError with the reason."""
        found, words = self._process.communicate()
        if self._killed:
            return None
        if self._process.returncode != 0:
            lines = words.decode(errors="replace").strip().splitlines()
            why = lines[-1] if lines else f"its process ended with code {self._process.returncode}"
            raise InputError(why if self._process.returncode == 2 else f"The occupancy map cannot be read: {why}.")
        if not found:
            return None
        with np.load(io.BytesIO(found)) as data:
            x, y = data["origin"].tolist()
            return OccupancyMap(data["cells"], float(data["resolution"]), (x, y))

    def kill(self) -> None:
        """Ends it; from any thread, also when it has ended."""
        self._killed = True
        self._process.kill()


def _read(path: Path) -> OccupancyMap | None:
    if path.is_file():
        from nvsim.occupancy.read import read_map

        return read_map(path)
    from nvsim.project.project import Project

    with Project.open(path) as project:
        return project.occupancy()


def main(path: Path) -> int:
    """Writes the map to the standard output, nothing where there is none; returns the exit code."""
    if hasattr(os, "nice"):
        os.nice(NICE)
    try:
        found = _read(path)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    if found is not None:
        written = io.BytesIO()
        np.savez(written, cells=found.cells, resolution=found.resolution, origin=found.origin)
        sys.stdout.buffer.write(written.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
