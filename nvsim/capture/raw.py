"""A capture as stored in its files, before alignment.

The readers of all formats return it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.types import Cloud, DepthFile, MaskFile, ScanFile
from nvsim.errors import InputError
from nvsim.files import opening
from nvsim.geometry.lens import Lens
from nvsim.geometry.rotation import is_rigid, matrix_from_quaternion

FARTHEST = 2.1e7  # source units: web Mercator reaches 20,037,508 m, UTM 10,000,000 m, the earth's surface 6.4e6 m
FAR = 1000.0  # source units; float32 is coarser than 0.1 mm beyond it, so points stay float64 in a RawCapture
LOST_FRAME = "the frame cannot be used, and a wrong one would degrade its submap"


@dataclass(frozen=True, eq=False)
class RawFrame:
    """An image as listed in the source.

    camera_to_world  (4, 4) float64 in the source's world with OpenCV axes, None if the source gives no usable pose
    lens             None if the source gives no usable lens
    where            file and line, or frame
    root             folder below which a moved image is searched by name
    choices          folders that match a moved image equally well, so none was chosen
    axes             camera axes of the file's poses, "opencv" or "opengl"
    rig              id of the rig that carries several cameras, "" if the camera is not on one
    """

    name: str
    image_path: Path
    lens: Lens | None
    camera_to_world: NDArray[np.float64] | None
    where: str
    sensor: str = "camera"
    timestamp: float = 0.0
    root: Path | None = None
    choices: tuple[Path, ...] = ()
    axes: str = "opencv"
    mask: MaskFile | None = None
    rig: str = ""


@dataclass(frozen=True, eq=False)
class RawCapture:
    """A capture before alignment.

    metric          whether the source claims that its unit is the meter; None if unknown, False for another unit
    scans, depths   in the source's own frame, like the poses and the point cloud
    metric_because  the mark for the claim, "" if the format itself makes it
    origin          (x, y, z) source units, already subtracted from all coordinates
    left_out        names of the frames that the user left out

    The points of the point cloud are float64 while they are far from the origin.
    """

    source: Path
    format: str
    frames: tuple[RawFrame, ...]
    cloud: Cloud | None
    metric: bool | None
    scans: tuple[ScanFile, ...] = ()
    depths: tuple[DepthFile, ...] = ()
    metric_because: str = ""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    left_out: frozenset[str] = frozenset()


def checked_pose(pose: NDArray[np.float64], where: str, findings: Findings) -> NDArray[np.float64] | None:
    """`pose` (4, 4) if it is rigid and not too far, otherwise None and an error finding with the reason."""
    if not np.isfinite(pose).all():
        findings.error("the pose holds a value that is not a finite number", where, LOST_FRAME)
    elif np.abs(pose).max() > FARTHEST:
        findings.error(f"the pose is farther than {FARTHEST:.2g} units from the origin", where, LOST_FRAME)
    elif is_rigid(pose):
        return pose
    elif np.linalg.det(pose[:3, :3]) < 0:
        findings.error(
            "the pose is a mirror image (its rotation has a negative determinant), so it is not rigid",
            where,
            "the source's axes have the opposite handedness; " + LOST_FRAME,
        )
    else:
        findings.error("the pose is not rigid (a rotation and a translation)", where, LOST_FRAME)
    return None


def pose_from_quaternion(
    quaternion: NDArray[np.float64], translation: NDArray[np.float64], where: str, findings: Findings
) -> NDArray[np.float64] | None:
    """(4, 4) float64 world-to-device pose from `quaternion` (4,) w x y z and `translation` (3,); None and an error
    finding if it is invalid."""
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(quaternion))
    if not np.isfinite(length):
        findings.error("the pose holds a value that is not a finite number", where, LOST_FRAME)
        return None
    if abs(length - 1) > 0.05:
        findings.error("the pose is not rigid (its quaternion has not length 1)", where, LOST_FRAME)
        return None
    pose = np.eye(4)
    pose[:3, :3] = matrix_from_quaternion(quaternion)
    pose[:3, 3] = translation
    return checked_pose(pose, where, findings)


def inverse(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse (4, 4) float64 of a rigid `pose` (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result


def natural_order(name: str) -> list[tuple[int, int, str]]:
    """A sort key that orders names by the numbers in them: f2.jpg is before f10.jpg."""
    pieces = re.split("([0-9]+)", name)
    digits = [piece.lstrip("0") for piece in pieces[1::2]]
    numbers = [(0, len(piece), piece) for piece in digits]
    texts = [(1, 0, piece) for piece in pieces[0::2]]
    ordered = [texts[0]]
    for number, text in zip(numbers, texts[1:], strict=True):
        ordered += [number, text]
    return ordered


def file_size(path: Path) -> int | None:
    """Size of a readable file in bytes; None if the file does not exist or the name is invalid."""
    try:
        return path.stat().st_size if path.is_file() else None
    except (OSError, ValueError):
        return None


def read_bytes(path: Path) -> bytes:
    """The content of `path`. Raises InputError naming the file if it cannot be read or is empty."""
    data = opening.read_bytes(path)
    if not data:
        raise InputError(f"{path} is empty (0 bytes); copy it again from the source.")
    return data


def read_text(path: Path) -> str:
    """UTF-8 text without a byte order mark. Raises InputError naming the file if it is not text."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text (byte {error.start}); save it as text and try again.") from error


def lines_of(text: str) -> Iterator[tuple[int, str]]:
    """Yield the number, from 1, and the text of each line. A list of a million short lines would need many times the
    memory of the file."""
    at, number = 0, 1
    while at <= len(text):
        end = text.find("\n", at)
        end = len(text) if end < 0 else end
        yield number, text[at:end]
        at, number = end + 1, number + 1


def whole_number(text: str) -> int:
    """The integer in `text`. Raises ValueError if it is not an integer of ASCII digits, at most 20 characters long."""
    if len(text) > 20:
        raise ValueError("too long for a number")
    if not re.fullmatch(r"[+-]?[0-9]+", text):
        raise ValueError("not an integer")
    return int(text)


def size_of_lens(size: tuple[float, float], center: tuple[float, float]) -> tuple[float, float]:
    """Width and height of the image that a lens belongs to, pixels. This is `size`, that of the image file, unless the
    `center` of the lens is not near its middle. Then the lens belongs to a larger or smaller copy."""
    if all(0.25 < at / side < 0.75 for at, side in zip(center, size, strict=True)):
        return size
    return round(2 * center[0]), round(2 * center[1])


LARGEST_SIDE = 65_535  # pixels; the limit of JPEG
FOCAL_RANGE = (0.1, 1e6)  # pixels


def read_lens(
    model: str, width: float, height: float, params: Sequence[float], where: str, findings: Findings
) -> Lens | None:
    """The lens, or None and an error finding if the model is unknown, or a count, a size, or a number is invalid."""
    if not all(1 <= v <= LARGEST_SIDE and v == int(v) for v in (width, height)):
        shown = "x".join(f"{v:g}" if abs(v) < 1e300 else "huge" for v in (width, height))
        findings.error(
            f"the image size {shown} is not two whole numbers of pixels",
            where,
            "no frame can use this camera",
        )
        return None
    try:
        lens = Lens(model, int(width), int(height), tuple(params))
    except (ValueError, OverflowError) as error:
        findings.error(str(error), where, "no frame can use this camera")
        return None
    if not all(FOCAL_RANGE[0] <= f <= FOCAL_RANGE[1] for f in lens.focal) or max(map(abs, params)) > FOCAL_RANGE[1]:
        findings.error(f"the camera parameters {lens.params} are not in pixels", where, "no frame can use this camera")
        return None
    return lens
