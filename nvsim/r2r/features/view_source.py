"""The 36 views of a viewpoint of an export: from `views/`, and where they are missing from its strip."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import TypeVar

import numpy as np

from nvsim.errors import InputError
from nvsim.files.decoding import decoded
from nvsim.files.regular import read_bytes
from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.r2r.features.backbone import Image
from nvsim.r2r.features.candidates import ELEVATIONS, HEADINGS
from nvsim.r2r.features.exported_scan import ExportedScan
from nvsim.r2r.features.kept_rows import FINGERPRINT
from nvsim.r2r.views_of_strips import StripViews, side_of

VIEWS = 36
WIDTH, HEIGHT, VFOV = 640, 480, 60
"""Of views that are sampled from strips: pixels and degrees."""
LARGEST = 1 << 28
"""Bytes of an image file."""
T = TypeVar("T")


class ViewSource:
    """The views of the viewpoints of one scan. May be asked by several threads."""

    def __init__(self, scan: ExportedScan) -> None:
        self._scan = scan
        self._samplers: dict[tuple[int, bytes], StripViews] = {}
        self._lock = Lock()

    def files(self, index: int) -> list[Path]:
        """The files that the views of the viewpoint `index` come from: 36, or its strip. Raises InputError where there
        are neither."""
        viewpoint = self._scan.viewpoints[index]
        views = [self._scan.view(viewpoint, i) for i in range(VIEWS)]
        missing = next((path for path in views if not path.is_file()), None)
        if missing is None:
            return views
        strip = self._scan.strip(viewpoint)
        if strip.is_file():
            return [strip]
        raise InputError(
            f"{missing} is missing, and so is the strip {strip} from which it could be sampled; "
            "export the images of the scan again."
        )

    def fingerprint(self, index: int) -> bytes:
        """16 bytes of the viewpoint's id, the sizes and times of its files, and the pose by which a strip is turned."""
        files = self.files(index)
        words = [(path.name, (found := os.stat(path)).st_size, found.st_mtime_ns) for path in files]
        pose = self._scan.rotations[index].tobytes() if len(files) == 1 else b""
        whose = f"{self._scan.id}_{self._scan.viewpoints[index]}"
        return hashlib.blake2b(repr((whose, words)).encode() + pose, digest_size=FINGERPRINT).digest()

    def each_view(self, index: int, use: Callable[[Image], T]) -> tuple[list[T], tuple[int, int]]:
        """What `use` makes of each of the 36 views, red, green, blue (H, W, 3) uint8, in the order of viewIndex; and
        their width and height in pixels. Holds one view at a time, or one strip.

        Raises InputError for an image that is missing, damaged, or of another size than those before.
        """
        files = self.files(index)
        if len(files) == 1:
            strip = _image(files[0], None)
            sampler = self._sampler(side_of(strip, str(files[0])), index)
            return [use(sampler.view(strip, i)) for i in range(VIEWS)], (WIDTH, HEIGHT)
        results, size = [], None
        for path in files:
            image = _image(path, size)
            size = image.shape[1], image.shape[0]
            results.append(use(image))
        assert size is not None
        return results, size

    def _sampler(self, side: int, index: int) -> StripViews:
        rotation = self._scan.rotations[index]
        key = side, np.round(rotation, 9).tobytes()
        with self._lock:
            if key not in self._samplers:
                self._samplers = {key: StripViews(_cameras(), rotation, side)}  # one is 70 MB
            return self._samplers[key]


def _cameras() -> list[Camera]:
    focal = HEIGHT / 2 / math.tan(math.radians(VFOV) / 2)
    intrinsics = Intrinsics(WIDTH, HEIGHT, focal, focal, WIDTH / 2, HEIGHT / 2)
    return [Camera(intrinsics, look(np.zeros(3), h, e)) for h, e in zip(HEADINGS, ELEVATIONS)]


def _image(path: Path, size: tuple[int, int] | None) -> Image:
    import cv2

    data = read_bytes(path, LARGEST)
    # The decoder fills with grey what a truncated JPEG lacks, and says so to nobody.
    if data.startswith(b"\xff\xd8") and b"\xff\xd9" not in data[-64:]:
        raise InputError(f"{path} ends before its image does; export the images of the scan again.")
    image = decoded(
        data,
        path,
        cv2.IMREAD_COLOR,
        size=size,
        size_of="the view before it",
        then="export the images of the scan again",
    )
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
