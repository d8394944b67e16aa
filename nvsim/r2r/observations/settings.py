"""The settings of an export. They are stored in the manifest, and changed settings make new images."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.errors import InputError

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
