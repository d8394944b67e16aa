"""Read COLMAP's text files line by line (colmap.github.io/format.html)."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.colmap_rows import CameraRow, FrameRow, ImageRow, RigRow
from nvsim.capture.raw import lines_of, read_text, whole_number
from nvsim.errors import InputError

_LONGEST_IMAGE = 4096  # characters; a longer line holds observations, which are not counted one by one
_CAMERA_TYPE = "CAMERA"


def read_cameras(path: Path) -> list[CameraRow]:
    """The cameras. Raises InputError naming the line if it is not a camera."""
    rows = []
    for line, fields in _lines(path):
        try:
            rows.append(
                CameraRow(
                    whole_number(fields[0]),
                    fields[1],
                    whole_number(fields[2]),
                    whole_number(fields[3]),
                    tuple(map(float, fields[4:])),
                    f"{path.name}, line {line}",
                )
            )
        except (ValueError, IndexError, OverflowError) as error:
            raise _bad(path, line, "ID MODEL WIDTH HEIGHT PARAMS...") from error
    return rows


def read_images(path: Path) -> list[ImageRow]:
    """Every image of images.txt. After each image, a line of observations may follow, be empty, or be missing.

    Raises InputError naming the line if it is neither an image nor a list of observations."""
    rows: list[ImageRow] = []
    after_image = False  # whether the next line may hold the observations of an image
    for line, text in lines_of(read_text(path)):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        if after_image and _is_observations(text):
            after_image = False
            continue
        fields = text.split(maxsplit=9)
        try:
            values = [float(v) for v in fields[1:8]]
            rows.append(
                ImageRow(
                    whole_number(fields[0]),
                    np.array(values[:4]),
                    np.array(values[4:7]),
                    whole_number(fields[8]),
                    fields[9].strip().replace("\\", "/"),
                    f"{path.name}, line {line}",
                )
            )
        except (ValueError, IndexError, OverflowError) as error:
            raise _bad(path, line, "ID QW QX QY QZ TX TY TZ CAMERA_ID NAME") from error
        after_image = True
    return rows


def _is_observations(text: str) -> bool:
    """Whether a line is a list of X Y POINT3D_ID. The last field of an image is its name, which usually is not a
    number. If the name is a number, the number of fields decides."""
    words = text.rsplit(maxsplit=1)
    try:
        float(words[-1])
    except ValueError:
        return False
    return len(text) > _LONGEST_IMAGE or len(text.split()) % 3 == 0


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """(N, 3) float64 positions and (N, 3) uint8 RGB colors. Raises InputError naming the line."""
    points, colors = array("d"), array("B")
    for line, fields in _lines(path, maxsplit=7):
        try:
            if len(fields) < 7:
                raise ValueError("too few fields")
            points.extend([float(v) for v in fields[1:4]])
            colors.extend([min(255, max(0, whole_number(v))) for v in fields[4:7]])
        except (ValueError, OverflowError) as error:
            raise _bad(path, line, "ID X Y Z R G B ERROR TRACK...") from error
    return np.array(points, np.float64).reshape(-1, 3), np.array(colors, np.uint8).reshape(-1, 3)


def read_rigs(path: Path) -> list[RigRow]:
    """The rigs. Raises InputError naming the line if it is not a rig."""
    rows = []
    for line, fields in _lines(path):
        try:
            number, sensors, at = whole_number(fields[0]), whole_number(fields[1]), 4
            reference = None
            if sensors and fields[2] == _CAMERA_TYPE:
                reference = whole_number(fields[3])
            mounts: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]] | None] = {}
            for _ in range(sensors - 1):
                kind, sensor, has_pose = fields[at], whole_number(fields[at + 1]), whole_number(fields[at + 2])
                pose = _pose_numbers(fields[at + 3 : at + 10]) if has_pose else None
                at += 10 if has_pose else 3
                if kind == _CAMERA_TYPE:
                    mounts[sensor] = None if pose is None else (pose[:4], pose[4:])
            rows.append(RigRow(number, reference, mounts, f"{path.name}, line {line}"))
        except (ValueError, IndexError, OverflowError) as error:
            expected = "RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID SENSORS..."
            raise _bad(path, line, expected) from error
    return rows


def read_frames(path: Path) -> list[FrameRow]:
    """The frames. Raises InputError naming the line if it is not a frame."""
    rows = []
    for line, fields in _lines(path):
        try:
            pose, count = _pose_numbers(fields[2:9]), whole_number(fields[9])
            data = fields[10 : 10 + 3 * count]
            if len(data) < 3 * count:
                raise ValueError("too few fields")
            images = tuple(whole_number(data[i + 2]) for i in range(0, len(data), 3) if data[i] == _CAMERA_TYPE)
            number, rig = whole_number(fields[0]), whole_number(fields[1])
            rows.append(FrameRow(number, rig, pose[:4], pose[4:], images, f"{path.name}, line {line}"))
        except (ValueError, IndexError, OverflowError) as error:
            expected = "FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA_IDS DATA_IDS..."
            raise _bad(path, line, expected) from error
    return rows


def _pose_numbers(fields: list[str]) -> NDArray[np.float64]:
    """(7,) quaternion w x y z and translation. Raises ValueError unless there are seven numbers."""
    if len(fields) != 7:
        raise ValueError("too few fields")
    return np.array([float(v) for v in fields])


def _lines(path: Path, maxsplit: int = -1) -> Iterator[tuple[int, list[str]]]:
    for line, text in lines_of(read_text(path)):
        fields = text.split(maxsplit=maxsplit)
        if fields and not fields[0].startswith("#"):
            yield line, fields


def _bad(path: Path, line: int, expected: str) -> InputError:
    return InputError(f"{path}, line {line}: expected {expected}; export the model again.")
