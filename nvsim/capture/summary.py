"""A capture in figures: how many images of which cameras and sizes, the way they were taken along, the cloud."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from nvsim.capture.raw import RawCapture
from nvsim.capture.types import Capture, CloudKind

_PATH = 1000  # places of the trajectory that are kept
_DIGITS = 3


@dataclass(frozen=True)
class Summary:
    """
    images       that the capture lists
    cameras      that took them
    sizes        (width, height, images of that size), the most frequent first, pixels
    scale_known  whether lengths are metres; units of the source otherwise
    length       of the trajectory, its width and depth seen from above
    path         (x, y) of the cameras in their order, aligned frame; of a long trajectory a part of them
    faulty       (x, y) of the cameras whose images cannot be used
    points       of the cloud, 0 where there is none
    cloud        where they come from, "" where there are none
    """

    images: int
    cameras: int
    sizes: tuple[tuple[int, int, int], ...]
    scale_known: bool = False
    length: float = 0.0
    width: float = 0.0
    depth: float = 0.0
    path: tuple[tuple[float, float], ...] = ()
    faulty: tuple[tuple[float, float], ...] = ()
    points: int = 0
    cloud: CloudKind | str = ""


def summary_of(raw: RawCapture, capture: Capture | None, bad: Collection[str]) -> Summary:
    """`capture` is `raw` in the aligned frame, None where it cannot be brought there; `bad` names the frames that
    cannot be used."""
    sizes = Counter((f.lens.width, f.lens.height) for f in raw.frames if f.lens is not None)
    points = 0 if raw.cloud is None else len(raw.cloud.points)
    counted = Summary(
        len(raw.frames),
        len({f.sensor for f in raw.frames}),
        tuple((width, height, count) for (width, height), count in sizes.most_common()),
        points=points,
        cloud=raw.cloud.kind if raw.cloud is not None and points else "",
    )
    if capture is None or not capture.frames:
        return counted
    positions = capture.positions
    extent = np.ptp(positions, axis=0)
    # A rig takes several images at a place: the way of one camera is the way of all.
    first = np.array([f.sensor == capture.frames[0].sensor for f in capture.frames])
    way = positions[first]
    thinned = way[:: -(-len(way) // _PATH)]
    marked = [p for f, p in zip(capture.frames, positions, strict=True) if f.name in bad][:_PATH]
    return Summary(
        counted.images,
        counted.cameras,
        counted.sizes,
        capture.alignment.scale_known,
        round(float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum()), _DIGITS),
        round(float(extent[0]), _DIGITS),
        round(float(extent[1]), _DIGITS),
        tuple((round(float(x), _DIGITS), round(float(y), _DIGITS)) for x, y in thinned[:, :2]),
        tuple((round(float(p[0]), _DIGITS), round(float(p[1]), _DIGITS)) for p in marked),
        counted.points,
        counted.cloud,
    )
