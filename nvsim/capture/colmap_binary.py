"""Read COLMAP's binary files, little-endian (colmap.github.io/format.html)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.colmap_rows import MODEL_NAMES, CameraRow, FrameRow, ImageRow, RigRow
from nvsim.capture.raw import read_bytes
from nvsim.errors import InputError
from nvsim.geometry.lens import PARAMETER_COUNTS

_OTHER_COUNTS = {
    "FOV": 5,
    "THIN_PRISM_FISHEYE": 12,
    "RAD_TAN_THIN_PRISM_FISHEYE": 16,
    "SIMPLE_DIVISION": 4,
    "DIVISION": 5,
    "SIMPLE_FISHEYE": 3,
    "FISHEYE": 4,
    "EUCM": 6,
    "EQUIRECTANGULAR": 2,
}  # parameter counts of models that NVSim does not support; the reader skips the parameters and names the model


class _FieldReader:
    """Reads fields sequentially. At the end of the file it raises InputError with the name of the record."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data = read_bytes(path)
        self.at = 0
        self.record = "the header"

    def records(self, what: str) -> Iterator[None]:
        """Read the number of records that follow, and set the name of each record before it is read."""
        for i in range(self.unpack(_COUNT)[0]):
            self.record = f"{what} record {i}"
            yield

    @property
    def location(self) -> str:
        return f"{self.path.name}, {self.record}"

    def unpack(self, layout: struct.Struct) -> tuple[Any, ...]:
        self.require_bytes(layout.size)
        values = layout.unpack_from(self.data, self.at)
        self.at += layout.size
        return values

    def skip(self, count: int) -> None:
        self.require_bytes(count)
        self.at += count

    def require_bytes(self, count: int) -> None:
        if count > len(self.data) - self.at:
            raise InputError(f"{self.path} ends in the middle of {self.record}; copy it again from the source.")

    def name(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            self.require_bytes(len(self.data) + 1)
        raw = self.data[self.at : end]
        self.at = end + 1
        try:
            return raw.decode()
        except UnicodeDecodeError as error:
            raise InputError(f"{self.path}, {self.record}: the image name is not UTF-8; rename the image.") from error


_COUNT = struct.Struct("<Q")
_CAMERA = struct.Struct("<iiQQ")
_IMAGE = struct.Struct("<i4d3di")
_POINT = struct.Struct("<Q3d3BdQ")
_RIG = struct.Struct("<II")
_SENSOR = struct.Struct("<iI")
_HAS_POSE = struct.Struct("<B")
_POSE = struct.Struct("<7d")
_FRAME = struct.Struct("<II7dI")
_DATA = struct.Struct("<iIQ")
_CAMERA_TYPE = 0


def read_cameras(path: Path) -> list[CameraRow]:
    """The cameras. Raises InputError naming the record if it is not a camera."""
    cursor = _FieldReader(path)
    rows = []
    for _ in cursor.records("camera"):
        number, model, width, height = cursor.unpack(_CAMERA)
        if not 0 <= model < len(MODEL_NAMES):
            raise InputError(f"{path}, {cursor.record}: camera model {model} is unknown; export the model as PINHOLE.")
        name = MODEL_NAMES[model]
        count = PARAMETER_COUNTS.get(name) or _OTHER_COUNTS[name]
        params = cursor.unpack(struct.Struct(f"<{count}d"))
        rows.append(CameraRow(number, name, width, height, params, cursor.location))
    return rows


def read_images(path: Path) -> list[ImageRow]:
    """The images. Raises InputError naming the record if it is not an image."""
    cursor = _FieldReader(path)
    rows = []
    for _ in cursor.records("image"):
        values = cursor.unpack(_IMAGE)
        name = cursor.name().replace("\\", "/")
        cursor.skip(cursor.unpack(_COUNT)[0] * 24)
        rotation, translation = np.array(values[1:5]), np.array(values[5:8])
        rows.append(ImageRow(values[0], rotation, translation, values[8], name, cursor.location))
    return rows


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """(N, 3) float64 positions and (N, 3) uint8 RGB colors. Raises InputError naming the record."""
    cursor = _FieldReader(path)
    points, colors = [], []
    for _ in cursor.records("point"):
        values = cursor.unpack(_POINT)
        points.append(values[1:4])
        colors.append(values[4:7])
        cursor.skip(values[8] * 8)
    return np.array(points, np.float64).reshape(-1, 3), np.array(colors, np.uint8).reshape(-1, 3)


def read_rigs(path: Path) -> list[RigRow]:
    """The rigs. Raises InputError naming the record if it is not a rig."""
    cursor = _FieldReader(path)
    rows = []
    for _ in cursor.records("rig"):
        number, sensors = cursor.unpack(_RIG)
        kind, reference = cursor.unpack(_SENSOR) if sensors else (-1, 0)
        mounts: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]] | None] = {}
        for _ in range(sensors - 1):
            sensor_kind, sensor = cursor.unpack(_SENSOR)
            pose = np.array(cursor.unpack(_POSE)) if cursor.unpack(_HAS_POSE)[0] else None
            if sensor_kind == _CAMERA_TYPE:
                mounts[sensor] = None if pose is None else (pose[:4], pose[4:])
        rows.append(RigRow(number, reference if kind == _CAMERA_TYPE else None, mounts, cursor.location))
    return rows


def read_frames(path: Path) -> list[FrameRow]:
    """The frames. Raises InputError naming the record if it is not a frame."""
    cursor = _FieldReader(path)
    rows = []
    for _ in cursor.records("frame"):
        number, rig, *pose, count = cursor.unpack(_FRAME)
        data = [cursor.unpack(_DATA) for _ in range(count)]
        images = tuple(image for kind, _, image in data if kind == _CAMERA_TYPE)
        rows.append(FrameRow(number, rig, np.array(pose[:4]), np.array(pose[4:]), images, cursor.location))
    return rows
