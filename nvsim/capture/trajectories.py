"""The trajectories of a capture: frames in recording order, one position per moment.

A rig takes several images at a moment, so its first camera represents all. Cameras without a rig share one trajectory,
because COLMAP gives each photo of an unordered set its own camera, and phones switch lenses during a recording.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.multi_capture import SUFFIX
from nvsim.capture.raw import RawFrame, inverse
from nvsim.capture.types import Capture

_LEAST_SHARED = 3  # minimum number of moments at which both cameras have an image
_STIFF = 0.05  # of the trajectory's size: tolerance of the relative position of two cameras on a rig


def trajectories(capture: Capture) -> list[NDArray[np.int64]]:
    """One int64 array (N,) of frame indices for each trajectory, in capture order.

    Each rig has a trajectory, and all cameras without a rig share one. Several captures in one have separate
    trajectories."""
    first: dict[tuple[str, str], str] = {}
    found: dict[tuple[str, str], list[int]] = {}
    is_list = capture.source.suffix == SUFFIX
    for index, frame in enumerate(capture.frames):
        label = frame.sensor.partition("/")[0] if is_list else ""
        key = label, frame.rig
        if not frame.rig or first.setdefault(key, frame.sensor) == frame.sensor:
            found.setdefault(key, []).append(index)
    return [np.array(indices, np.int64) for indices in found.values()]


def with_rigs(frames: Sequence[RawFrame], moments: Sequence[Hashable]) -> list[RawFrame]:
    """`frames` with rigs inferred for a source that lists no rigs; `moments` has one moment per frame.

    Two cameras are on one rig if two conditions hold. At least half of the images of each share their moment with an
    image of the other, and the relative position of the cameras is constant. An empty moment is shared with no other
    image."""
    by_moment: dict[Hashable, dict[str, RawFrame]] = {}
    for frame, moment in zip(frames, moments, strict=True):
        if moment != "":
            by_moment.setdefault(moment, {}).setdefault(frame.sensor, frame)
    counts = Counter(frame.sensor for frame in frames)
    shared: dict[tuple[str, str], list[tuple[RawFrame, RawFrame]]] = {}
    for taken in by_moment.values():
        sensors = list(taken)
        for other in sensors[1:]:  # the first camera identifies the rig
            shared.setdefault((sensors[0], other), []).append((taken[sensors[0]], taken[other]))
    rig_of: dict[str, str] = {}
    for (one, other), pairs in shared.items():
        enough = max(_LEAST_SHARED, max(counts[one], counts[other]) / 2)
        if len(pairs) >= enough and _is_stiff(pairs):
            rig_of.setdefault(other, rig_of.setdefault(one, one))
    return [replace(f, rig=rig_of[f.sensor]) if f.sensor in rig_of else f for f in frames]


def _is_stiff(pairs: Sequence[tuple[RawFrame, RawFrame]]) -> bool:
    """Whether the position of the second camera in the axes of the first is constant for at least half of the pairs."""
    posed = [(a.camera_to_world, b.camera_to_world) for a, b in pairs]
    both = [(a, b) for a, b in posed if a is not None and b is not None]
    if len(both) < _LEAST_SHARED:
        return False
    offsets = np.array([(inverse(a) @ b)[:3, 3] for a, b in both])
    size = float(np.linalg.norm(np.ptp([a[:3, 3] for a, _ in both], axis=0)))
    deviation = np.linalg.norm(offsets - np.median(offsets, axis=0), axis=1)
    return bool(np.median(deviation) <= _STIFF * size)
