"""Read a point cloud file into a Cloud: the steps shared by PLY and PCD after their columns are read."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from nvsim.capture import pcd, ply
from nvsim.capture.findings import Findings
from nvsim.capture.point_table import Columns
from nvsim.capture.raw import FAR, FARTHEST, read_bytes
from nvsim.capture.types import Cloud, CloudKind
from nvsim.errors import InputError
from nvsim.files.reading import reading

_COLOR_NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))


def read_cloud(path: Path, findings: Findings, kind: CloudKind = "lidar") -> Cloud:
    """The point cloud in a PLY or PCD file; its content decides the format.

    Raises InputError naming the file if it is empty, truncated, or of another format."""
    with reading(path, "a point cloud", "export it again"):
        return _read(path, findings, kind)


def _read(path: Path, findings: Findings, kind: CloudKind) -> Cloud:
    data = read_bytes(path)
    if data.startswith(b"ply"):
        columns = ply.parse(path, data)
    elif b"FIELDS" in data[:4096]:
        columns = pcd.parse(path, data)
    else:
        raise InputError(f"{path} is neither PLY nor PCD; convert the cloud to one of these.")
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"{path} has no point coordinate {', '.join(missing)}; export it with x, y and z.")
    with np.errstate(invalid="ignore"):  # a signaling NaN is another point that is skipped
        points = np.stack([columns[axis].astype(np.float64) for axis in "xyz"], axis=1)
    return usable_cloud(points, _colors(columns), kind, path.name, findings)


def usable_cloud(
    points: NDArray[np.float64], colors: NDArray[np.uint8] | None, kind: CloudKind, where: str, findings: Findings
) -> Cloud:
    """A point cloud of the `points` (N, 3) that are finite and plausibly near; a warning counts the skipped points.

    `points` and `colors` (N, 3) uint8 RGB are in the unit and frame of the source."""
    good = np.asarray((np.abs(np.nan_to_num(points, nan=np.inf)) < FARTHEST).all(axis=1))
    if not good.all():
        left_out = int(np.count_nonzero(~good))
        findings.warning(f"{left_out} of {len(good)} points are not finite or too far", where, "they are left out")
        points, colors = points[good], None if colors is None else colors[good]
    return Cloud(stored_points(points), colors, kind)


def stored_points(points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Points (N, 3) as stored in the point cloud of a RawCapture: float32, or float64 if they are far from the origin.

    Beyond 1000 units, float32 is too coarse. `subtract_origin` converts all points to float32."""
    if len(points) and np.abs(points).max() > FAR:
        return cast(NDArray[np.float32], points)
    return points.astype(np.float32)


def _colors(columns: Columns) -> NDArray[np.uint8] | None:
    """(N, 3) uint8 RGB from three columns (integers to 255 or 65535, or fractions of 1) or from PCD's packed column."""
    for names in _COLOR_NAMES:
        if all(name in columns for name in names):
            values = np.stack([columns[name] for name in names], axis=1)
            if values.dtype == np.uint16:
                return (values.astype(np.uint16) >> 8).astype(np.uint8)
            scale = 255.0 if values.dtype.kind == "f" else 1.0
            return np.clip(np.nan_to_num(values.astype(np.float64)) * scale, 0, 255).round().astype(np.uint8)
    packed = columns.get("rgb", columns.get("rgba"))
    if packed is None or packed.dtype.itemsize != 4:
        return None
    bits = np.ascontiguousarray(packed).view(np.uint32)
    return np.stack([(bits >> shift) & 255 for shift in (16, 8, 0)], axis=1).astype(np.uint8)


def merge(clouds: list[Cloud], voxel: float = 0.02, most: int = 4_000_000) -> Cloud | None:
    """All clouds in one; None if `clouds` is empty.

    Above `most` points, only the first point in each cube of `voxel` meters is kept, so that a day of LiDAR scans fits
    into memory."""
    if not clouds:
        return None
    points = np.concatenate([c.points for c in clouds])
    colors = None
    if all(c.colors is not None for c in clouds):
        colors = np.concatenate([c.colors for c in clouds if c.colors is not None])
    if len(points) > most:
        keys = np.floor((points - points.min(axis=0)) / voxel).astype(np.int64)
        keys = (keys[:, 0] << 42) | (keys[:, 1] << 21) | keys[:, 2]
        kept = np.sort(np.unique(keys, return_index=True)[1])
        points, colors = points[kept], None if colors is None else colors[kept]
    return Cloud(points, colors, clouds[0].kind)
