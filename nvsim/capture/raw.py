"""A capture as its files say it, before alignment: what the reader of every format returns."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.types import Cloud, DepthFile, MaskFile, ScanFile
from nvsim.errors import InputError
from nvsim.files import regular
from nvsim.geometry.lens import Lens
from nvsim.geometry.rotation import is_rigid, matrix_from_quaternion

FARTHEST = 2.1e7  # source units: web Mercator reaches 20,037,508 m, UTM 10,000,000 m, the earth's surface 6.4e6 m
FAR = 1000.0  # source units; beyond it float32 is coarser than 0.1 mm, so points stay float64 until an origin is off
LOST_FRAME = "the frame cannot be used, and a wrong one would spoil its submap"


@dataclass(frozen=True, eq=False)
class RawFrame:
    """One image as listed. `camera_to_world` (4, 4) float64 in the source's world with OpenCV axes, None where the
    source gives no usable pose; `lens` None where the source gives no usable one; `where` is file and line or frame.
    `root` is the folder below which a moved image is looked for by name; `choices` are the folders that fit equally
    well, so that none was taken. `axes` names the camera axes of the file's poses, "opencv" or "opengl"; `rig` is the
    id of the rig that carries several cameras, "" if the camera is not on one."""

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

    metric          whether the source claims that its unit is the meter; None where nothing tells, False for another
    scans, depths   in the source's own frame, as the poses and the cloud
    metric_because  the mark that claims it, "" if the format does
    origin          (x, y, z) source units, which was taken off all coordinates
    left_out        names of the frames that the user left out

    The points of the cloud are float64 while they are far from the origin.
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
    """`pose` (4, 4) when it is rigid and near, otherwise None and an error finding that says what is wrong."""
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
            "the axes of the source are of another handedness; " + LOST_FRAME,
        )
    else:
        findings.error("the pose is not rigid (a rotation and a translation)", where, LOST_FRAME)
    return None


def pose_from_quaternion(
    quaternion: NDArray[np.float64], translation: NDArray[np.float64], where: str, findings: Findings
) -> NDArray[np.float64] | None:
    """(4, 4) world-to-device from (4,) w x y z and (3,), or None and an error finding."""
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
    """The inverse of a rigid (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result


def natural_order(name: str) -> list[tuple[int, int, str]]:
    """A sort key that orders names by the numbers in them: f2.jpg comes before f10.jpg."""
    pieces = re.split("([0-9]+)", name)
    digits = [piece.lstrip("0") for piece in pieces[1::2]]
    numbers = [(0, len(piece), piece) for piece in digits]
    texts = [(1, 0, piece) for piece in pieces[0::2]]
    ordered = [texts[0]]
    for number, text in zip(numbers, texts[1:], strict=True):
        ordered += [number, text]
    return ordered


def file_size(path: Path) -> int | None:
    """Bytes of a readable file; None where there is none (or where no file can have such a name)."""
    try:
        return path.stat().st_size if path.is_file() else None
    except (OSError, ValueError):
        return None


def read_bytes(path: Path) -> bytes:
    """The content of `path`. Raises InputError naming it when it cannot be read or is empty."""
    data = regular.read_bytes(path)
    if not data:
        raise InputError(f"{path} is empty (0 bytes); copy it again from the source.")
    return data


def read_text(path: Path) -> str:
    """UTF-8 text, a byte order mark dropped. Raises InputError naming the file when it is not text."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text (byte {error.start}); save it as text and try again.") from error


def lines_of(text: str) -> Iterator[tuple[int, str]]:
    """Number, from 1, and words of each line, one at a time: a list of a million short ones takes many times the
    memory of the file."""
    at, number = 0, 1
    while at <= len(text):
        end = text.find("\n", at)
        end = len(text) if end < 0 else end
        yield number, text[at:end]
        at, number = end + 1, number + 1


def whole_number(text: str) -> int:
    """Raises ValueError for what is no whole number of at most 19 digits, more than any format has room for."""
    if len(text) > 20:
        raise ValueError("too long for a number")
    return int(text)
