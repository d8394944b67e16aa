"""Subtract an origin from large coordinates (UTM, ECEF, site grids) in double precision, before any float32 conversion.

Four million meters from the origin, float32 has steps of 0.25 m. `Alignment.origin` stores the subtracted origin.
Exports in the capture's own frame add it again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.raw import FAR, RawCapture
from nvsim.capture.types import Cloud

_ROUND = 100.0  # source units; the origin is a multiple
_TIMES = 3.0  # extents of the trajectory; a nearer origin occurs in large captures and in fine units
_MAP = 1e5  # source units; larger coordinates are of a map projection or of the earth, in meters
_COARSE = 0.005  # source units; float32 steps that are too coarse for a floor


def subtract_origin(raw: RawCapture, findings: Findings) -> RawCapture:
    """`raw` with an origin subtracted from its poses, point cloud, LiDAR scans, and depth images; a note reports it.

    The origin is rounded. It is subtracted if the cameras are more than 1000 units from the source's origin. The point
    cloud becomes float32 in any case."""
    positions = np.array([f.camera_to_world[:3, 3] for f in raw.frames if f.camera_to_world is not None])
    origin = _origin_of(positions)
    if not np.any(origin):
        return replace(raw, cloud=_shifted_cloud(raw.cloud, origin))
    words = ", ".join(f"{v:.0f}" for v in origin)
    findings.note(
        f"the coordinates are far from the origin, so ({words}) is subtracted",
        raw.source.name,
        "32-bit numbers are too coarse there; exports in the capture's frame add it again",
    )
    if raw.cloud is not None and len(raw.cloud.points):
        points = raw.cloud.points
        step = float(np.spacing(np.float32(np.abs(points).max())))
        if step > _COARSE and np.array_equal(points, points.astype(np.float32)):
            findings.warning(
                f"the cloud was written as 32-bit numbers, whose steps are {step:.3g} units so far from the origin",
                raw.source.name,
                "its surfaces are that coarse; export it with 64-bit coordinates or nearer to the origin",
            )
    claims = raw.metric or bool(np.abs(origin).max() >= _MAP)
    return replace(
        raw,
        frames=tuple(
            f if f.camera_to_world is None else replace(f, camera_to_world=_shifted(f.camera_to_world, origin))
            for f in raw.frames
        ),
        cloud=_shifted_cloud(raw.cloud, origin),
        scans=tuple(replace(s, to_world=_shifted(s.to_world, origin)) for s in raw.scans),
        depths=tuple(replace(d, camera_to_world=_shifted(d.camera_to_world, origin)) for d in raw.depths),
        metric=claims,
        metric_because=raw.metric_because if raw.metric else "the coordinates are map coordinates" if claims else "",
        origin=(float(origin[0]), float(origin[1]), float(origin[2])),
    )


def _origin_of(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) multiples of 100 source units near the cameras (N, 3). An axis is 0 if the cameras are near the origin on
    it."""
    if not len(positions):
        return np.zeros(3)
    middle = np.median(positions, axis=0)
    extent = float(np.ptp(np.quantile(positions, [0.05, 0.95], axis=0), axis=0).max())
    if np.abs(middle).max() <= max(FAR, _TIMES * extent):
        return np.zeros(3)
    return np.where(np.abs(middle) > FAR, np.round(middle / _ROUND) * _ROUND, 0.0)


def _shifted(pose: NDArray[np.float64], origin: NDArray[np.float64]) -> NDArray[np.float64]:
    moved = pose.copy()
    moved[:3, 3] -= origin
    return moved


def _shifted_cloud(cloud: Cloud | None, origin: NDArray[np.float64]) -> Cloud | None:
    if cloud is None or (cloud.points.dtype == np.float32 and not np.any(origin)):
        return cloud
    return replace(cloud, points=(cloud.points.astype(np.float64) - origin).astype(np.float32))
