"""What a sensor saw from one place: the points in which its rays ended, of a scan or of a depth image."""

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

_STILL = 0.05  # metres; scans of a sensor that is never elsewhere are of its points, not of its place


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
        stored = read_depth_image(depth)
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
