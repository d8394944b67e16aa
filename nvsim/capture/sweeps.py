"""Sweeps: the end points of a sensor's rays from one position, in a LiDAR scan or in a depth image."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.depth_images import read_depth_image
from nvsim.capture.findings import Findings
from nvsim.capture.pointcloud import read_cloud
from nvsim.capture.types import DepthFile, ScanFile
from nvsim.geometry.camera import Camera

_STILL = 0.05  # meters; if a scanner never moves farther, its scans are in world coordinates without a position


@dataclass(frozen=True, eq=False)
class Sweep:
    """origin  (3,) float64, meters, world: position of the sensor
    points  (N, 3) float64, meters, world: end points of its rays
    """

    origin: NDArray[np.float64]
    points: NDArray[np.float64]


def scans_with_places(scans: Sequence[ScanFile]) -> list[ScanFile]:
    """The scans of scanners that moved, whose poses give the position of the scanner. A merged cloud is stored as one
    scan at the world origin and is not returned."""
    ordered = sorted(scans, key=lambda scan: scan.sensor)
    found = []
    for _, group in groupby(ordered, key=lambda scan: scan.sensor):
        of_sensor = list(group)
        places = np.array([scan.to_world[:3, 3] for scan in of_sensor])
        if np.ptp(places, axis=0).max() > _STILL:
            found += of_sensor
    return found


def scan_sweeps(scans: Sequence[ScanFile]) -> Iterator[Sweep]:
    """Yield one sweep per LiDAR scan. Raises InputError if a file cannot be read."""
    for scan in scans:
        points = scan.scale * read_cloud(scan.path, Findings()).points.astype(np.float64)
        origin = scan.to_world[:3, 3]
        yield Sweep(origin, points @ scan.to_world[:3, :3].T + origin)


def depth_sweeps(depths: Sequence[DepthFile], longest_side: int) -> Iterator[Sweep]:
    """Yield one sweep per depth image, sampled at no more than `longest_side` pixels per side. Raises InputError if a
    file cannot be read."""
    for depth in depths:
        intrinsics = depth.lens.pinhole.limited_to(longest_side)
        stored = read_depth_image(depth)
        # Positions of the pinhole's pixels in the stored image, whose size may differ from the lens's.
        mapping = depth.lens.undistort_map(intrinsics) + 0.5
        scale = np.array(stored.shape[::-1]) / (depth.lens.width, depth.lens.height)
        columns, rows = np.moveaxis(np.floor(mapping * scale).astype(np.int64), -1, 0)
        inside = (columns >= 0) & (rows >= 0) & (columns < stored.shape[1]) & (rows < stored.shape[0])
        seen = np.where(inside, stored[np.where(inside, rows, 0), np.where(inside, columns, 0)], 0)
        yield sweep_of_depth(Camera(intrinsics, depth.camera_to_world), seen)


def sweep_of_depth(camera: Camera, depth: NDArray[np.floating]) -> Sweep:
    """The sweep of `depth` (H, W), which has the size of `camera`: meters along its optical axis, 0 where unknown."""
    rows, columns = np.nonzero(depth > 0)
    k, z = camera.intrinsics, depth[rows, columns].astype(np.float64)
    local = np.stack([(columns + 0.5 - k.cx) / k.fx * z, (rows + 0.5 - k.cy) / k.fy * z, z], axis=1)
    return Sweep(camera.position, local @ camera.rotation.T + camera.position)
