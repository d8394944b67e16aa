"""Files that the window opens without a project: connectivity files with the map and the cloud beside them, and splat
files of any program. Does not use Qt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.files.placeholders import is_metadata_name
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.graph.connectivity import read_connectivity, scan_of
from nvsim.graph.foreign import ForeignFile, connectivity_files
from nvsim.splats.formats.choice import read_splats, source_up_axis
from nvsim.splats.turning import Up, upright
from nvsim.splats.types import Gaussians, SubmapModel
from nvsim_app.drawing.painter import Models
from nvsim_app.state.graph_files import ForeignGraph
from nvsim_app.state.loading import Contents, with_derived_arrays
from nvsim_app.state.side_work import start_reading


class GraphSource:
    """A connectivity file, or the first scan of a folder of connectivity files."""

    def __init__(self, path: Path) -> None:
        """Raises InputError if a folder contains no connectivity file."""
        files = _without_stub(connectivity_files(path))
        self.path = files[0]
        self.scans = tuple(files if len(files) > 1 else _siblings(path))

    def contents(self) -> Contents:
        """Reads the file, and the map and the cloud beside it. Raises InputError with the entry and the reason if a
        file is damaged."""
        file = ForeignFile.open(self.path)
        child = None if file.nearby_files.map is None else start_reading(file.nearby_files.map)
        cloud = file.nearby_files.points()
        occupancy = None if child is None else child.result()
        return with_derived_arrays(
            Contents(
                self.path,
                graph=file.graph,
                graph_file=ForeignGraph(file, self.scans),
                cloud=cloud,
                occupancy=occupancy,
                notes=() if occupancy is None else occupancy.notes,
            )
        )


def _siblings(path: Path) -> list[Path]:
    """All connectivity files in the folder of `path`, sorted by name."""
    if not path.is_file():
        return [path]
    found = sorted(p for p in path.parent.glob("*_connectivity.json") if not is_metadata_name(p.name))
    return found if _is_stub(path) else _without_stub(found)


def _is_stub(path: Path) -> bool:
    """Whether a connectivity file is the stub scan of `nvsim export`."""
    from nvsim.r2r.observations.stub import SCAN, is_stub

    if scan_of(path) != SCAN:
        return False
    try:
        return is_stub(read_connectivity(path))
    except InputError:
        return False  # reading it gives the reason


def _without_stub(files: Sequence[Path]) -> list[Path]:
    """The files without the stub scan of `nvsim export`, which is not a building; all files if there is no other."""
    return [path for path in files if not _is_stub(path)] or list(files)


BULK = (2.0, 98.0)
"""Percentiles of the positions between which the object is; Gaussians outside are floaters."""


@dataclass(frozen=True)
class SplatFile:
    """The splat file at `path` with its up axis. The rendering process can open it."""

    path: Path
    up: Up

    @staticmethod
    def of(path: Path) -> SplatFile:
        """The splat file with the up axis that the file suggests. Raises InputError if it cannot be read."""
        return SplatFile(path, source_up_axis(path))

    def contents(self) -> Contents:
        """The contents for the window: the outline of the Gaussians. Raises InputError if the file cannot be read."""
        splats = read_splats(self.path)
        outline = outline_of(upright(splats.gaussians, self.up))
        return Contents(self.path, scene_stamp=self, outline=outline, notes=splats.notes)

    def open(self) -> Models:
        """The model for the rendering process. Raises InputError if the file cannot be read."""
        splats = read_splats(self.path)
        gaussians = upright(splats.gaussians, self.up)
        model = SubmapModel(gaussians, None, None, FloorSurface.flat(0.0), bool(splats.antialiased))
        return Models(lambda camera: (0, model))


def outline_of(gaussians: Gaussians) -> np.ndarray:
    """(8, 3) float64 corners of the box around the bulk of the Gaussians; (0, 3) if there are none."""
    if len(gaussians) == 0:
        return np.zeros((0, 3))
    low, high = np.percentile(gaussians.means, BULK, axis=0)
    picks = np.indices((2, 2, 2)).reshape(3, -1).T
    return np.where(picks, high, low).astype(np.float64)
