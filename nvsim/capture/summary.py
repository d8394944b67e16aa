"""Statistics of a capture: the number of images, cameras, and image sizes; the trajectories; the point cloud."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.raw import RawCapture
from nvsim.capture.trajectories import trajectories
from nvsim.capture.types import Capture, CloudKind

_PATH = 1000  # positions of a trajectory that are stored
_DIGITS = 3


@dataclass(frozen=True)
class Summary:
    """
    images       number of images in the capture
    cameras      number of cameras
    sizes        (width, height, number of images of that size), the most frequent first, pixels
    scale_known  whether lengths are in meters; otherwise in units of the source
    length       of the trajectories; `width` and `depth` are their extent seen from above
    paths        (x, y) of the cameras in order, aligned frame, for each trajectory; long ones are subsampled
    faulty       (x, y) of the cameras whose images cannot be used
    points       of the point cloud, 0 if there is none
    cloud        source of the points, "" if there are none
    depth_images number of usable depth images
    masks        number of usable image masks
    """

    images: int
    cameras: int
    sizes: tuple[tuple[int, int, int], ...]
    scale_known: bool = False
    length: float = 0.0
    width: float = 0.0
    depth: float = 0.0
    paths: tuple[tuple[tuple[float, float], ...], ...] = ()
    faulty: tuple[tuple[float, float], ...] = ()
    points: int = 0
    cloud: CloudKind | str = ""
    depth_images: int = 0
    masks: int = 0


def summary_of(raw: RawCapture, capture: Capture | None, bad: Collection[str]) -> Summary:
    """The statistics of `raw`. `capture` is `raw` in the aligned frame, or None if it cannot be aligned. `bad` lists
    the names of unusable frames."""
    sizes = Counter((f.lens.width, f.lens.height) for f in raw.frames if f.lens is not None)
    points = 0 if raw.cloud is None else len(raw.cloud.points)
    counted = Summary(
        len(raw.frames),
        len({f.sensor for f in raw.frames}),
        tuple((width, height, count) for (width, height), count in sizes.most_common()),
        points=points,
        cloud=raw.cloud.kind if raw.cloud is not None and points else "",
        depth_images=len(raw.depths),
        masks=sum(f.mask is not None for f in raw.frames),
    )
    if capture is None or not capture.frames:
        return counted
    positions = capture.positions
    extent = np.ptp(positions, axis=0)
    ways = [positions[indices] for indices in trajectories(capture)]
    lengths = [np.linalg.norm(np.diff(way, axis=0), axis=1).sum() for way in ways]
    marked = [p for f, p in zip(capture.frames, positions, strict=True) if f.name in bad][:_PATH]
    return Summary(
        counted.images,
        counted.cameras,
        counted.sizes,
        capture.alignment.scale_known,
        round(float(np.sum(lengths)), _DIGITS),
        round(float(extent[0]), _DIGITS),
        round(float(extent[1]), _DIGITS),
        tuple(_places(way[:: -(-len(way) // _PATH)]) for way in ways),
        _places(np.array(marked).reshape(-1, 3)),
        counted.points,
        counted.cloud,
        counted.depth_images,
        counted.masks,
    )


def _places(positions: NDArray[np.float64]) -> tuple[tuple[float, float], ...]:
    return tuple((round(float(p[0]), _DIGITS), round(float(p[1]), _DIGITS)) for p in positions)
