"""Reads the scans of an exported folder: `connectivity/` with scans.txt, and the 36 views of each viewpoint.

The views are read from `views/`, or sampled from the skybox strips.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.images import decode_pixels, is_cut_off
from nvsim.files.opening import read_bytes, read_json
from nvsim.geometry.directions import HEIGHT, VFOV, VIEWS, WIDTH, heading_and_elevation
from nvsim.graph.connectivity import read_connectivity, scan_files
from nvsim.graph.skybox_files import FOLDER, SkyboxFiles
from nvsim.r2r.features.backbone import Image
from nvsim.r2r.features.kept_rows import FINGERPRINT
from nvsim.r2r.simulator.compiled_drawing import draw_colors
from nvsim.r2r.simulator.images import rays_of, read_colors

LARGEST = 1 << 28
"""Largest size of an image file in bytes."""
T = TypeVar("T")


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


class ViewSource:
    """The views of the viewpoints of one scan. Several threads may use it."""

    def __init__(self, scan: ExportedScan) -> None:
        self._scan = scan

    def files(self, index: int) -> list[Path]:
        """Returns the files with the views of the viewpoint `index`: 36 images, or its strip.

        Raises InputError if neither exists.
        """
        viewpoint = self._scan.viewpoints[index]
        views = [self._scan.view(viewpoint, i) for i in range(VIEWS)]
        missing = next((path for path in views if not path.is_file()), None)
        if missing is None:
            return views
        strip = self._scan.skyboxes.strip(viewpoint)
        if strip.is_file():
            return [strip]
        raise InputError(
            f"{missing} is missing, and so is the strip {strip} from which it could be sampled; "
            "export the images of the scan again."
        )

    def fingerprint(self, index: int) -> bytes:
        """Returns a hash of 16 bytes: the viewpoint id, the files' sizes and times, and for a strip the pose."""
        files = self.files(index)
        words = [(path.name, (found := os.stat(path)).st_size, found.st_mtime_ns) for path in files]
        pose = self._scan.rotations[index].tobytes() if len(files) == 1 else b""
        whose = f"{self._scan.id}_{self._scan.viewpoints[index]}"
        return hashlib.blake2b(repr((whose, words)).encode() + pose, digest_size=FINGERPRINT).digest()

    def each_view(self, index: int, use: Callable[[Image], T]) -> tuple[list[T], tuple[int, int]]:
        """Applies `use` to each of the 36 views, RGB (H, W, 3) uint8, in the order of viewIndex.

        Returns the results and the views' width and height in pixels. Only one view or strip is in memory at a time.

        Raises InputError if an image is missing, damaged, or of another size than the previous ones.
        """
        files = self.files(index)
        if len(files) == 1:
            return [use(view) for view in self._sampled(index)], (WIDTH, HEIGHT)
        results, size = [], None
        for path in files:
            image = _image(path, size)
            size = image.shape[1], image.shape[0]
            results.append(use(image))
        assert size is not None
        return results, size

    def _sampled(self, index: int) -> Iterator[Image]:
        """Yields the views that the simulator samples from the strip."""
        strip = read_colors(self._scan.skyboxes.folder, self._scan.viewpoints[index])[..., ::-1]
        strip, rotation = np.ascontiguousarray(strip), self._scan.rotations[index]
        for view in range(VIEWS):
            rays, _ = rays_of(rotation, *heading_and_elevation(view), WIDTH, HEIGHT, VFOV)
            image = np.empty((HEIGHT, WIDTH, 3), np.uint8)
            draw_colors(strip, rays, image)
            yield image


def _image(path: Path, size: tuple[int, int] | None) -> Image:
    import cv2

    data = read_bytes(path, LARGEST)
    if is_cut_off(data):
        raise InputError(f"{path} is truncated; export the images of the scan again.")
    image = decode_pixels(
        data,
        path,
        cv2.IMREAD_COLOR,
        size=size,
        size_of="the previous view",
        then="export the images of the scan again",
    )
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
