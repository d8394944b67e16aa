"""Photos of a building: upright copies no larger than needed, and camera data from Exif 2.32."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import read_bytes
from nvsim.footage.extraction import LONGEST_SIDE, QUALITY
from nvsim.footage.sources import FEWEST_PHOTOGRAPHS, Footage

_APPLE = frozenset({".heic", ".heif"})
_KEPT = {"JPEG": ".jpg", "PNG": ".png"}  # formats whose files are copied if they are upright and small
_LARGEST = 400_000_000  # pixels
_FILM = 43.267  # mm, diagonal of 35 mm film, to which the equivalent focal length refers (CIPA DCG-001)
_EXIF, _MAKE, _MODEL, _TIME, _TIME_PART = 0x8769, 271, 272, 36867, 37521
_FOCAL, _FOCAL_35, _PLANE_RESOLUTION, _PLANE_UNIT = 37386, 41989, 41486, 41488
_MILLIMETERS = {2: 25.4, 3: 10.0, 4: 1.0}  # millimeters in each unit of the focal plane resolution


@dataclass(frozen=True)
class PhotographCamera:
    """width, height  pixels of the stored images
    focal          focal length from Exif in pixels of the stored images; None if unknown
    name           maker, model, and zoom; separates images of different cameras with equal image size
    """

    width: int
    height: int
    focal: float | None
    name: str


@dataclass(frozen=True, eq=False)
class StoredPhotographs:
    """
    folder      folder of the images
    names       names of the N stored images, in order of time if all photos have a time, else in order of file name
    cameras     the cameras of the photos
    camera      (N,) int64, index into `cameras`
    unreadable  names of photos that cannot be decoded
    """

    folder: Path
    names: tuple[str, ...]
    cameras: tuple[PhotographCamera, ...]
    camera: NDArray[np.int64]
    unreadable: tuple[str, ...]


@dataclass(frozen=True)
class _Photograph:
    """data    content of the file to store, with this `suffix`
    camera  the camera of the photo
    time    time of the photo as sortable text; "" if unknown
    """

    data: bytes
    suffix: str
    camera: PhotographCamera
    time: str


def store_photographs(
    footage: Footage, folder: Path, stored: Callable[[int, int], None] = lambda done, total: None
) -> StoredPhotographs:
    """Stores copies of the photos in `folder`. Raises InputError if fewer than three can be decoded, if HEIC files
    cannot be read with the installed libraries, and if writing fails."""
    allow_heic(footage)
    atomic.make_folder(folder)
    stems = Counter(path.stem for path in footage.files)
    found: list[tuple[str, PhotographCamera, str]] = []
    unreadable = []

    def store(path: Path) -> tuple[str, PhotographCamera, str] | None:
        photograph = _read(path)
        if photograph is None:
            return None
        name = f"{path.stem if stems[path.stem] == 1 else path.name}{photograph.suffix}"
        atomic.write_bytes(folder / name, photograph.data)
        return name, photograph.camera, photograph.time

    with ThreadPoolExecutor() as pool:
        for path, photograph in zip(footage.files, pool.map(store, footage.files), strict=True):
            if photograph is None:
                unreadable.append(path.name)
            else:
                found.append(photograph)
            stored(len(found) + len(unreadable), len(footage.files))
    if len(found) < FEWEST_PHOTOGRAPHS:
        raise InputError(f"{footage.source} has {len(found)} photographs that can be decoded; give at least 3.")
    if all(time for _, _, time in found):
        found.sort(key=lambda each: each[2])
    cameras = tuple(dict.fromkeys(camera for _, camera, _ in found))
    index = np.array([cameras.index(camera) for _, camera, _ in found], np.int64)
    return StoredPhotographs(folder, tuple(name for name, _, _ in found), cameras, index, tuple(unreadable))


def allow_heic(footage: Footage) -> None:
    """Enables HEIC in Pillow if a photo needs it. Raises InputError if the library is not installed."""
    first = next((path for path in footage.files if path.suffix.lower() in _APPLE), None)
    if first is None:
        return
    try:
        from pillow_heif import register_heif_opener  # an extra
    except ImportError as error:
        raise InputError(
            f"{first} is HEIC, which needs pillow-heif; install it with `pip install 'nvsim[heic]'`, or export the "
            "photographs as JPEG."
        ) from error
    register_heif_opener()


def _read(path: Path) -> _Photograph | None:
    """The photo to store. None if the file cannot be decoded."""
    try:
        data = read_bytes(path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(BytesIO(data)) as image:
                return _prepare_photo(data, image)
    # Damaged files raise many kinds of errors in the decoders and in the Exif tables.
    except (OSError, ValueError, SyntaxError, TypeError, KeyError, ArithmeticError, MemoryError, EOFError, InputError):
        return None
    except Image.DecompressionBombError:
        return None


def _prepare_photo(data: bytes, image: Image.Image) -> _Photograph:
    """The photo, upright and reduced in size. Its bytes do not change if neither is needed."""
    if image.width * image.height > _LARGEST:
        raise ValueError("too many pixels")
    exif = image.getexif()
    tags: dict[int, Any] = {**exif, **exif.get_ifd(_EXIF)}
    shrink = min(1.0, LONGEST_SIDE / max(image.size))
    kind, size = image.format or "", image.size
    focal = _focal(tags, *size)
    if shrink < 1:
        image.draft("RGB", (round(size[0] * shrink), round(size[1] * shrink)))
    upright = ImageOps.exif_transpose(image).convert("RGB")
    if upright.width > upright.height:
        size = max(size), min(size)
    else:
        size = min(size), max(size)
    width, height = max(1, round(size[0] * shrink)), max(1, round(size[1] * shrink))
    name = " ".join(str(tags.get(tag, "")) for tag in (_MAKE, _MODEL, _FOCAL))
    camera = PhotographCamera(width, height, None if focal is None else focal * shrink, name)
    time = f"{tags[_TIME]}.{tags.get(_TIME_PART, '')}" if _TIME in tags else ""
    if kind in _KEPT and shrink == 1 and exif.get(0x0112, 1) == 1 and image.mode in ("RGB", "L"):
        return _Photograph(data, _KEPT[kind], camera, time)
    pixels = np.asarray(upright)[:, :, ::-1]
    if pixels.shape[:2] != (height, width):
        pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
    encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
    return _Photograph(encoded.tobytes(), ".jpg", camera, time)


def _focal(tags: dict[int, Any], width: int, height: int) -> float | None:
    """Focal length in pixels of an image of this size. None if Exif has none or it is implausible."""
    longer = max(width, height)
    if equivalent := float(tags.get(_FOCAL_35) or 0):
        focal = equivalent / _FILM * float(np.hypot(width, height))
    else:
        unit = _MILLIMETERS.get(int(tags.get(_PLANE_UNIT) or 0), 0.0)
        resolution = float(tags.get(_PLANE_RESOLUTION) or 0)
        focal = float(tags.get(_FOCAL) or 0) * resolution / unit if unit else 0.0
    return focal if 0.3 * longer < focal < 10 * longer else None
