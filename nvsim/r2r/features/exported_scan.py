"""The scans of an exported folder, read back: `connectivity/` with scans.txt, `views/` and the strips of skyboxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.regular import read_json
from nvsim.graph.connectivity import read_connectivity, scan_files
from nvsim.graph.skybox_files import FOLDER, SkyboxFiles


@dataclass(frozen=True, eq=False)
class ExportedScan:
    """One scan below the folder of an export; viewpoints that are not included are left out.

    id          the scan id
    root        the folder of the export
    viewpoints  (n) their ids, in the order of the connectivity file
    positions   (n, 3) float64, metres, world
    rotations   (n, 3, 3) float64, camera-to-world of the pose: columns right, down and ahead
    edges       (m, 2) int64, from and to, each edge both ways, sorted
    """

    id: str
    root: Path
    viewpoints: tuple[str, ...]
    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]
    edges: NDArray[np.int64]

    @property
    def has_images(self) -> bool:
        """Whether there is a folder that may hold its images."""
        return (self.root / "views" / self.id).is_dir() or self.skyboxes.folder.is_dir()

    def view(self, viewpoint: str, index: int) -> Path:
        return self.root / "views" / self.id / viewpoint / f"{index}.jpg"

    @property
    def skyboxes(self) -> SkyboxFiles:
        return SkyboxFiles(self.root / self.id / FOLDER)


def read_exported_scans(root: Path, names: Sequence[str] = ()) -> list[ExportedScan]:
    """The scans `names` of the export in `root`, all that its scans.txt lists where none is named. `root` may also be
    the folder of the connectivity files itself.

    Raises InputError when scans.txt lists none, does not list a named one, or a connectivity file cannot be read.
    """
    return [_read_scan(root, name, path) for name, path in scan_files(root, names).items()]


def _read_scan(root: Path, name: str, path: Path) -> ExportedScan:
    graph = read_connectivity(path)
    poses = {entry["image_id"]: entry["pose"] for entry in read_json(path, "a connectivity file", "export it again")}
    included = [v for v in graph.viewpoints.values() if v.included]
    for viewpoint in included:
        if viewpoint.id in (".", "..") or any(c.isspace() or not c.isprintable() for c in viewpoint.id):
            raise InputError(f"{path}: the viewpoint id {viewpoint.id!r} names no file of images; rename it.")
    index = {v.id: i for i, v in enumerate(included)}
    pairs = [(index[a], index[b]) for a, b in graph.edges if a in index and b in index]
    return ExportedScan(
        name,
        root,
        tuple(index),
        np.array([v.position for v in included], np.float64).reshape(-1, 3),
        np.array([poses[v.id] for v in included], np.float64).reshape(-1, 4, 4)[:, :3, :3],
        np.array(sorted([*pairs, *((b, a) for a, b in pairs)]), np.int64).reshape(-1, 2),
    )
