"""Frames whose pose is so far from the trajectory that no map could hold both.

One wrong pose some kilometres away asks for a map that reaches it. The trajectory's own size says what is far: in
metres, the distance from the middle that half of the cameras keep; without a scale, that of nine in ten, or 20 steps.
(Many robots stand still for half of the time, so that half of the cameras alone may say nothing about the size of a
trajectory.)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.types import Capture
from nvsim.geometry.cells import MOST_CELLS

_TIMES = 50.0  # the trajectory's own size, beyond which a camera belongs to another place, or to none
_LEAST = 10.0  # metres that every trajectory is taken to be large
_STEPS = 20.0  # median steps that a trajectory is at least large
_LISTED = 20
_AROUND, _CELL = 24.0, 0.08  # metres: what a map shows beyond the trajectory, and the cells of the supported floor


def far_from_the_walk(capture: Capture) -> NDArray[np.bool_]:
    """(N,) which of the frames have their camera beyond 50 times the size of the trajectory."""
    positions = capture.positions
    if len(positions) < 3:
        return np.zeros(len(positions), bool)
    afar = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    if capture.alignment.scale_known:
        size = max(float(np.median(afar)), _LEAST)
    else:
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        size = max(float(np.quantile(afar, 0.9)), _STEPS * float(np.median(steps)))
    return np.asarray((afar > _TIMES * size) & (size > 0))


def check_far_frames(capture: Capture, where: Mapping[str, str], findings: Findings) -> bool:
    """Whether all frames are near enough to each other; otherwise an error finding that names those far from the
    trajectory and the option that leaves them out, or one for a trajectory that is wider than any map. `where`: places
    by name."""
    positions = capture.positions
    far = far_from_the_walk(capture)
    if far.any():
        frames = [f for f, is_far in zip(capture.frames, far, strict=True) if is_far]
        distance = float(np.linalg.norm(positions[far] - np.median(positions, axis=0), axis=1).max())
        names = ",".join(f.name for f in frames[:_LISTED]) + (",..." if len(frames) > _LISTED else "")
        plural = "s are" if len(frames) > 1 else " is"
        findings.error(
            f"{len(frames)} camera{plural} up to {distance:.4g} away from the trajectory; correct the pose or give "
            f"--leave-out {names}",
            ", ".join(where[f.name] for f in frames[:_LISTED]),
            "the map would have to reach there, which no memory holds",
            tuple(f.name for f in frames),
        )
        return False
    if capture.alignment.scale_known and len(positions):
        x, y = np.ptp(positions[:, :2], axis=0)
        if (x + _AROUND) * (y + _AROUND) > MOST_CELLS * _CELL**2:
            findings.error(
                f"the cameras span {x:.4g} x {y:.4g} m, more than a map can hold",
                capture.source.name,
                f"a map has at most {MOST_CELLS * _CELL**2 / 1e6:.2g} square kilometres; correct the "
                "scale, import a part, or leave frames out with --leave-out",
            )
            return False
    return True
