"""Metrics of camera poses in an unknown frame and unit, compared with true poses after the best similarity."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nvsim.geometry.rotation import fitted_similarity

FAR = 0.5  # meters; cameras with a larger error are wrong

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scores:
    """
    position_median, position_max   meters between estimated and true camera positions
    rotation_median                 degrees between estimated and true camera rotations
    relative_median, relative_max   degrees between estimated and true rotations from one camera to the next
    far                             number of cameras more than `FAR` meters off
    extent                          meters, diagonal of the bounding box of the true positions
    """

    position_median: float
    position_max: float
    rotation_median: float
    relative_median: float
    relative_max: float
    far: int
    extent: float


def score(estimated: Array, true: Array) -> Scores:
    """Compares camera-to-world matrices (N, 4, 4) with true ones (N, 4, 4) in meters, both in order of time, after the
    similarity that fits the positions best.

    Raises ValueError if there are fewer than three poses or all estimated positions coincide.
    """
    if len(true) < 3 or len(estimated) != len(true):
        raise ValueError(f"A similarity needs at least 3 pairs of poses, not {len(estimated)} and {len(true)}.")
    if np.ptp(estimated[:, :3, 3], axis=0).max() == 0:
        raise ValueError("All camera positions coincide, so no similarity can be estimated.")
    scale, rotation, shift = fitted_similarity(estimated[:, :3, 3], true[:, :3, 3])
    off = np.linalg.norm(scale * estimated[:, :3, 3] @ rotation.T + shift - true[:, :3, 3], axis=1)
    turned = _angles((rotation @ estimated[:, :3, :3]).transpose(0, 2, 1) @ true[:, :3, :3])
    ours, theirs = (p[:-1, :3, :3].transpose(0, 2, 1) @ p[1:, :3, :3] for p in (estimated, true))
    relative = _angles(ours.transpose(0, 2, 1) @ theirs)
    return Scores(
        float(np.median(off)),
        float(off.max()),
        float(np.median(turned)),
        float(np.median(relative)),
        float(relative.max()),
        int((off > FAR).sum()),
        float(np.linalg.norm(np.ptp(true[:, :3, 3], axis=0))),
    )


def read_poses(path: Path) -> dict[int, Array]:
    """Reads camera-to-world matrices (4, 4) by frame number, from lines with a number and a row-major matrix.

    The nearest rotation replaces each 3 x 3 part, so that rounded digits do not count as an error.
    """
    poses = {}
    for line in path.read_text().splitlines():
        if line.strip() and not line.startswith("#"):
            words = line.split()
            pose = np.array(words[1:], float).reshape(4, 4)
            u, _, vt = np.linalg.svd(pose[:3, :3])
            pose[:3, :3] = u @ vt
            poses[int(words[0])] = pose
    return poses


def _angles(rotations: Array) -> Array:
    """Angles (N,) of rotations (N, 3, 3), degrees."""
    return np.degrees(Rotation.from_matrix(rotations).magnitude())
