"""What a sensor saw from one place: the points in which its rays ended, of a scan or of a depth image."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.pointcloud import read_cloud
from nvsim.capture.types import DepthFile, ScanFile
from nvsim.errors import InputError
from nvsim.files.regular import read_bytes
from nvsim.geometry.camera import Camera

_STILL = 0.05  # metres; scans of a sensor that is never elsewhere are of its points, not of its place
_NOTHING = 65.5  # metres; the largest number of 16 bits stands for nothing as often as 0 does
_AGAIN = "a depth image has one channel of 16 bits, millimetres"


@dataclass(frozen=True, eq=False)
class Sweep:
    """origin  (3,) float64, metres, world
    points  (N, 3) float64, metres, world: where its rays ended
    """

    origin: NDArray[np.float64]
    points: NDArray[np.float64]


def scans_with_places(scans: Sequence[ScanFile]) -> list[ScanFile]:
    """Those of the `scans` whose pose says where the scanner was: of a scanner that moved. A merged cloud comes as one
    scan at the world's zero."""
    ordered = sorted(scans, key=lambda scan: scan.sensor)
    found = []
    for _, group in groupby(ordered, key=lambda scan: scan.sensor):
        of_sensor = list(group)
        places = np.array([scan.to_world[:3, 3] for scan in of_sensor])
        if np.ptp(places, axis=0).max() > _STILL:
            found += of_sensor
    return found


def scan_sweeps(scans: Sequence[ScanFile]) -> Iterator[Sweep]:
    """One for each scan. Raises InputError when a file cannot be read."""
    for scan in scans:
        points = scan.scale * read_cloud(scan.path, Findings()).points.astype(np.float64)
        origin = scan.to_world[:3, 3]
        yield Sweep(origin, points @ scan.to_world[:3, :3].T + origin)


def depth_sweeps(depths: Sequence[DepthFile], longest_side: int) -> Iterator[Sweep]:
    """One for each depth image, of at most `longest_side` pixels a side: of more, those in the middle of each. Raises
    InputError when a file cannot be read."""
    for depth in depths:
        intrinsics = depth.lens.pinhole.within(longest_side)
        stored = depth.scale * _read(depth)
        # Where the pixels of the pinhole lie in the image as stored, whose size may be another than the lens's.
        mapping = depth.lens.undistort_map(intrinsics) + 0.5
        scale = np.array(stored.shape[::-1]) / (depth.lens.width, depth.lens.height)
        columns, rows = np.moveaxis(np.floor(mapping * scale).astype(np.int64), -1, 0)
        inside = (columns >= 0) & (rows >= 0) & (columns < stored.shape[1]) & (rows < stored.shape[0])
        seen = np.where(inside, stored[np.where(inside, rows, 0), np.where(inside, columns, 0)], 0)
        yield sweep_of_depth(Camera(intrinsics, depth.camera_to_world), seen)


def sweep_of_depth(camera: Camera, depth: NDArray[np.floating]) -> Sweep:
    """The sweep of `depth` (H, W) of the size of `camera`, metres along its optical axis, 0 where unknown."""
    rows, columns = np.nonzero(depth > 0)
    k, z = camera.intrinsics, depth[rows, columns].astype(np.float64)
    local = np.stack([(columns + 0.5 - k.cx) / k.fx * z, (rows + 0.5 - k.cy) / k.fy * z, z], axis=1)
    return Sweep(camera.position, local @ camera.rotation.T + camera.position)


def _read(file: DepthFile) -> NDArray[np.float64]:
    """(H, W) metres, 0 where unknown."""
    data = read_bytes(file.path)
    width, height = file.lens.width, file.lens.height
    if file.is_raw:
        if len(data) != 4 * width * height:
            raise InputError(
                f"{file.path} has {len(data)} bytes, not the {4 * width * height} of {width}x{height} depths as "
                "float32; copy it again from the source."
            )
        found = np.frombuffer(data, "<f4").reshape(height, width).astype(np.float64)
        return np.where((found > 0) & (found < _NOTHING), found, 0.0)
    import cv2

    from nvsim.files.decoding import decoded

    stored = decoded(data, file.path, cv2.IMREAD_UNCHANGED, what="a depth image", then=_AGAIN)
    if stored.ndim != 2 or stored.dtype != np.uint16:
        raise InputError(f"{file.path} is no depth image: {_AGAIN}; write it anew.")
    found = stored / 1000.0
    return np.where(found < _NOTHING, found, 0.0)
