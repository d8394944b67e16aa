"""What an export makes, as a value; it stands in the manifest, and a change of it makes images anew."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.errors import InputError

_STEP = 16  # pixels: a block of a JPEG whose chroma is subsampled, so that none lies over two faces in any reader


@dataclass(frozen=True)
class ScanSettings:
    """Raises InputError for a size or a quality that cannot be.

    size      pixels of a side of a face
    quality   of JPEG files
    faces     whether the six faces are written as single files too
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
