"""The layout of an exported scan: settings, file locations, and encoding of images.

The settings are stored in the manifest, and changed settings make new images. A folder may contain many scans.
Matterport3DSimulator uses the folder as its dataset path and `connectivity` as its path of navigation graphs.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.directions import VIEWS
from nvsim.graph.connectivity import SUFFIX
from nvsim.graph.skybox_files import FOLDER, SkyboxFiles

_STEP = 16  # pixels: a JPEG block with subsampled chroma, so that no block covers two faces


@dataclass(frozen=True)
class ScanSettings:
    """The settings of an export. Raises InputError if the size or the quality is out of range.

    size      side of a face in pixels
    quality   of JPEG files, 50 to 100
    faces     whether the six faces are also written as single files
    views     whether the 36 views are written
    plans     whether floor plans are drawn
    """

    size: int = 512
    quality: int = 95
    faces: bool = False
    views: bool = False
    plans: bool = True

    def __post_init__(self) -> None:
        if not 64 <= self.size <= 1024 or self.size % _STEP:
            raise InputError(
                f"A face cannot be {self.size} pixels wide; give --size a multiple of {_STEP} from 64 to 1024."
            )
        if not 50 <= self.quality <= 100:
            raise InputError(f"JPEG files cannot have the quality {self.quality}; give --quality from 50 to 100.")


@dataclass(frozen=True)
class ScanPlaces:
    """The folder `root` of an export, and one scan in it."""

    root: Path
    scan: str

    @property
    def folder(self) -> Path:
        """The folder of the images that the simulator reads, and of the manifest."""
        return self.root / self.scan

    @property
    def manifest(self) -> Path:
        return self.folder / "manifest.json"

    @property
    def journal(self) -> Path:
        """The list of finished parts of an unfinished export."""
        return self.folder / ".unfinished.jsonl"

    @property
    def lock(self) -> Path:
        return self.folder / ".writer"

    @property
    def images(self) -> Path:
        return self.folder / FOLDER

    @property
    def graphs(self) -> Path:
        return self.root / "connectivity"

    @property
    def connectivity(self) -> Path:
        return self.graphs / f"{self.scan}{SUFFIX}"

    @property
    def scans(self) -> Path:
        return self.graphs / "scans.txt"

    @property
    def views(self) -> Path:
        return self.root / "views" / self.scan

    @property
    def plans(self) -> Path:
        return self.root / "floor_plans" / self.scan

    @property
    def skyboxes(self) -> SkyboxFiles:
        return SkyboxFiles(self.images)

    def view_paths(self, viewpoint: str) -> list[Path]:
        """Returns the paths of the 36 views, in the order of viewIndex."""
        return [self.views / viewpoint / f"{i}.jpg" for i in range(VIEWS)]

    def is_image_of_scan(self, file: str) -> bool:
        """Whether a path below the root, as a manifest names it, is an image of this scan."""
        path = self.root / file
        here = path.parent in (self.images, self.plans) or path.parent.parent == self.views
        return here and ".." not in path.parts


def jpeg(color: NDArray[np.uint8], quality: int, whole_chroma: bool) -> bytes:
    """Encodes an RGB image (H, W, 3) uint8 as JPEG.

    With `whole_chroma`, the chroma is not subsampled (4:4:4). Otherwise it is 4:2:0, which is smaller, but colors bleed
    across the borders of 16-pixel blocks.
    """
    import cv2

    sampling = cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444 if whole_chroma else cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
    return _encoded(".jpg", color[..., ::-1], options)


def png(pixels: NDArray[np.generic]) -> bytes:
    """Encodes one channel (H, W), or RGB (H, W, 3), with 8 or 16 bits, as PNG."""
    return _encoded(".png", pixels[..., ::-1] if pixels.ndim == 3 else pixels, [])


def _encoded(suffix: str, pixels: NDArray[np.generic], options: list[int]) -> bytes:
    import cv2

    return bytes(cv2.imencode(suffix, np.ascontiguousarray(pixels), options)[1].tobytes())
