"""Recognize footage: one video, a folder of videos, the sides of a 360 degree rig, or a folder of photos."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.capture.image_folder import has_other_content
from nvsim.capture.raw import natural_order
from nvsim.errors import InputError, value_text
from nvsim.files.images import ImageSize, image_size_of
from nvsim.files.opening import opened

VIDEO_SUFFIXES = frozenset({".mp4", ".mov", ".mkv", ".webm", ".m4v", ".avi"})
PHOTOGRAPH_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff", ".heic", ".heif"})
FEWEST_PHOTOGRAPHS = 3
FEWEST_SIDES = 3
_HEAD, _TAIL = 1 << 20, 1 << 22  # bytes at both ends of a file that are searched for spherical metadata
Stamp = tuple[tuple[str, int, int], ...]
"""Path, size in bytes, and modification time (nanoseconds) of every file."""
_MARKS = (b"equirectangular", b"sv3d", b"<GSpherical:Spherical>true")


@dataclass(frozen=True)
class Footage:
    """Files of one building without camera poses.

    source  the file or folder that the user gave
    kind    "video": `files` are videos; "photographs": `files` are images
    files   in natural order of their names ("IMG_2" before "IMG_10")
    others  images beside the photographs that are not used: their names are those of depth images, masks, and the like
    """

    source: Path
    kind: Literal["video", "photographs"]
    files: tuple[Path, ...]
    others: tuple[Path, ...] = ()

    @property
    def sides(self) -> int:
        """Number of sides of a 360 degree rig, if the videos are named side0, side1, ...; otherwise 0."""
        names = [file.stem.lower() for file in self.files]
        is_rig = len(names) >= FEWEST_SIDES and names == [f"side{k}" for k in range(len(names))]
        return len(names) if is_rig and self.kind == "video" else 0

    @property
    def others_text(self) -> str:
        """A sentence about the images that are not used, without its full stop; "" for none."""
        if not self.others:
            return ""
        example = value_text(self.others[0].name)
        count = f"{len(self.others):,} images are" if len(self.others) > 1 else "1 image is"
        return f"{count} not used because of names like {example}, as depth images and masks have"

    @property
    def description(self) -> str:
        """The footage in words, for a sentence: "a video", "35 photographs"."""
        if self.sides:
            return f"{self.sides} sides of a 360 degree video"
        if self.kind == "photographs":
            return f"{len(self.files)} photographs"
        return "a video" if len(self.files) == 1 else f"{len(self.files)} videos"


def find_footage(path: Path) -> Footage | None:
    """Finds the footage at `path`, by file names only. None if there is none.

    A folder with videos is a video capture, even if it also has images. Images in subfolders are ignored. Hidden files
    are ignored.
    """
    try:
        if path.is_file():
            return Footage(path, "video", (path,)) if path.suffix.lower() in VIDEO_SUFFIXES else None
        if not path.is_dir():
            return None
        there = (f for f in path.iterdir() if not f.name.startswith(".") and f.is_file())
        files = sorted(there, key=lambda f: natural_order(f.name.lower()))
    except (OSError, ValueError):
        return None
    videos = tuple(f for f in files if f.suffix.lower() in VIDEO_SUFFIXES)
    if videos:
        return Footage(path, "video", videos)
    images = tuple(f for f in files if f.suffix.lower() in PHOTOGRAPH_SUFFIXES)
    others = tuple(f for f in images if has_other_content(f.stem))
    photographs = tuple(f for f in images if not has_other_content(f.stem))
    if len(photographs) < FEWEST_PHOTOGRAPHS:  # the names mean something else
        photographs, others = images, ()
    return Footage(path, "photographs", photographs, others) if len(photographs) >= FEWEST_PHOTOGRAPHS else None


def need_footage(path: Path) -> Footage:
    """Like `find_footage`. Raises InputError if there is none."""
    found = find_footage(path)
    if found is None:
        raise InputError(
            f"{path} is neither a video ({', '.join(sorted(VIDEO_SUFFIXES))}) nor a folder with videos or with at "
            f"least {FEWEST_PHOTOGRAPHS} photographs; check the path."
        )
    return found


def is_equirectangular(width: int, height: int) -> bool:
    """Whether an image of this size in pixels can be a whole panorama: twice as wide as high."""
    return height >= 64 and abs(width - 2 * height) <= 2


def is_panoramic(footage: Footage) -> bool:
    """Whether the footage is of a 360 degree camera: the sides of a rig, or images that are twice as wide as high.

    Opens the first video, or the first, middle, and last photo. Raises InputError for a video that cannot be
    decoded."""
    if footage.sides:
        return True
    if footage.kind == "video":
        from nvsim.footage.decoding import video_facts  # imports OpenCV, which would slow the start of the window

        facts = video_facts(footage.files[0])
        return is_equirectangular(facts.width, facts.height)
    files = footage.files
    sizes = [_photograph_size(file) for file in (files[0], files[len(files) // 2], files[-1])]
    return all(size is not None and is_equirectangular(size.width, size.height) for size in sizes)


def _photograph_size(file: Path) -> ImageSize | None:
    with suppress(InputError, OSError), opened(file) as opened_file:
        return image_size_of(opened_file.read(_HEAD))
    return None


def says_spherical(path: Path) -> bool:
    """Whether the metadata of a video or photo declare a panorama: XMP's ProjectionType, or the spherical box of
    MP4."""
    with suppress(InputError, OSError), opened(path) as file:
        head = file.read(_HEAD)
        file.seek(max(0, path.stat().st_size - _TAIL))
        tail = file.read(_TAIL)
        return any(mark in part for mark in _MARKS for part in (head, tail))
    return False
