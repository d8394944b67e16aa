"""Find frames whose pose is too far from the trajectory for one map.

A single wrong pose some kilometers away would require a map that reaches it. The limit depends on the size of the
trajectory. If the scale is known, the size is the median distance of the cameras from their middle. Otherwise it is the
distance that nine of ten cameras keep, or 20 median steps between frames. (Many robots do not move half of the time, so
the median distance alone may say nothing about the size of a trajectory.)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.types import Capture
from nvsim.geometry.cells import MOST_CELLS

_TIMES = 50.0  # sizes of the trajectory; a camera beyond this distance is too far
_LEAST = 10.0  # meters, the minimum size of a trajectory
_STEPS = 20.0  # median steps between frames, the minimum size of a trajectory without a scale
_LISTED = 20
_AROUND, _CELL = 24.0, 0.08  # meters: width of a map beyond the trajectory, and its cells of supported floor


def find_far_frames(capture: Capture) -> NDArray[np.bool_]:
    """(N,) bool, True for frames whose camera is farther than 50 times the size of the trajectory from its middle."""
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
    """Whether all frames are near enough to each other for one map.

    Otherwise an error finding names the frames that are far from the trajectory, and the option that removes them. A
    trajectory that is wider than any map also gives an error finding. `where` maps frame names to file and line."""
    positions = capture.positions
    far = find_far_frames(capture)
    if far.any():
        frames = [f for f, is_far in zip(capture.frames, far, strict=True) if is_far]
        distance = float(np.linalg.norm(positions[far] - np.median(positions, axis=0), axis=1).max())
        names = ",".join(f.name for f in frames[:_LISTED]) + (",..." if len(frames) > _LISTED else "")
        plural = "s are" if len(frames) > 1 else " is"
        findings.error(
            f"{len(frames)} camera{plural} up to {distance:.4g} away from the trajectory; correct the pose or give "
            f"--leave-out {names}",
            ", ".join(where[f.name] for f in frames[:_LISTED]),
            "the map would have to reach these cameras, which exceeds any memory",
            tuple(f.name for f in frames),
        )
        return False
    if capture.alignment.scale_known and len(positions):
        x, y = np.ptp(positions[:, :2], axis=0)
        if (x + _AROUND) * (y + _AROUND) > MOST_CELLS * _CELL**2:
            findings.error(
                f"the cameras span {x:.4g} x {y:.4g} m, more than a map can hold",
                capture.source.name,
                f"a map has at most {MOST_CELLS * _CELL**2 / 1e6:.2g} square kilometers; correct the "
                "scale, import a part, or remove frames with --leave-out",
            )
            return False
    return True
