"""Reads the scans of an exported folder: `connectivity/` with scans.txt, `views/`, and the skybox strips."""

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
    """One exported scan, without viewpoints that are not included.

    id          the scan id
    root        the folder of the export
    viewpoints  (n) viewpoint ids, in the order of the connectivity file
    positions   (n, 3) float64, meters, world
    rotations   (n, 3, 3) float64, camera-to-world rotation of the pose: columns right, down and ahead
    edges       (m, 2) int64, from and to, each edge in both directions, sorted
    """

    id: str
    root: Path
    viewpoints: tuple[str, ...]
    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]
    edges: NDArray[np.int64]

    @property
    def has_images(self) -> bool:
        """Whether a folder for the images of the scan exists."""
        return (self.root / "views" / self.id).is_dir() or self.skyboxes.folder.is_dir()

    def view(self, viewpoint: str, index: int) -> Path:
        return self.root / "views" / self.id / viewpoint / f"{index}.jpg"

    @property
    def skyboxes(self) -> SkyboxFiles:
        return SkyboxFiles(self.root / self.id / FOLDER)


def read_exported_scans(root: Path, names: Sequence[str] = ()) -> list[ExportedScan]:
    """Reads the scans `names` of the export in `root`, or all scans in its scans.txt if `names` is empty.

    `root` may also be the folder of the connectivity files.

    Raises InputError if scans.txt lists no scans or lacks a named scan, or if a connectivity file is unreadable.
    """
    return [_read_scan(root, name, path) for name, path in scan_files(root, names).items()]


def _read_scan(root: Path, name: str, path: Path) -> ExportedScan:
    graph = read_connectivity(path)
    poses = {entry["image_id"]: entry["pose"] for entry in read_json(path, "a connectivity file", "export it again")}
    included = [v for v in graph.viewpoints.values() if v.included]
    for viewpoint in included:
        if viewpoint.id in (".", "..") or any(c.isspace() or not c.isprintable() for c in viewpoint.id):
            raise InputError(f"{path}: the viewpoint id {viewpoint.id!r} cannot be the name of image files; rename it.")
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
