"""Metrics of camera poses in an unknown frame and unit, compared with true poses after the best similarity."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FAR = 0.5  # meters; cameras with a larger error are wrong

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Similarity:
    """A similarity that maps a point p to scale * rotation @ p + shift; rotation is (3, 3), shift (3,)."""

    scale: float
    rotation: Array
    shift: Array

    def points(self, points: Array) -> Array:
        """The transformed points (N, 3) of points (N, 3)."""
        return np.asarray(self.scale * points @ self.rotation.T + self.shift)


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


def best_similarity(source: Array, target: Array) -> Similarity:
    """The least-squares similarity from points (N, 3) to points (N, 3), N >= 3 (Umeyama 1991).

    Raises ValueError if there are fewer than three points or all source points coincide.
    """
    if len(source) < 3 or len(source) != len(target):
        raise ValueError(f"A similarity needs at least 3 pairs of points, not {len(source)} and {len(target)}.")
    middle, aim = source.mean(axis=0), target.mean(axis=0)
    spread = float(((source - middle) ** 2).sum(axis=1).mean())
    if spread == 0:
        raise ValueError("All camera positions coincide, so no similarity can be estimated.")
    u, sizes, vt = np.linalg.svd((target - aim).T @ (source - middle) / len(source))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ np.diag(signs) @ vt
    scale = float(sizes @ signs) / spread
    return Similarity(scale, rotation, aim - scale * rotation @ middle)


def angles(rotations: Array) -> Array:
    """Angles (N,) of rotations (N, 3, 3), degrees; exact for small angles too."""
    trace = np.trace(rotations, axis1=1, axis2=2)
    skew = rotations - rotations.transpose(0, 2, 1)
    sine = np.sqrt(skew[:, 2, 1] ** 2 + skew[:, 0, 2] ** 2 + skew[:, 1, 0] ** 2)
    return np.asarray(np.degrees(np.arctan2(sine, trace - 1)))


def score(estimated: Array, true: Array) -> Scores:
    """Compares camera-to-world matrices (N, 4, 4) with true ones (N, 4, 4) in meters, both in order of time.

    Raises ValueError as `best_similarity` does.
    """
    fit = best_similarity(estimated[:, :3, 3], true[:, :3, 3])
    off = np.linalg.norm(fit.points(estimated[:, :3, 3]) - true[:, :3, 3], axis=1)
    turned = angles((fit.rotation @ estimated[:, :3, :3]).transpose(0, 2, 1) @ true[:, :3, :3])
    ours, theirs = (p[:-1, :3, :3].transpose(0, 2, 1) @ p[1:, :3, :3] for p in (estimated, true))
    relative = angles(ours.transpose(0, 2, 1) @ theirs)
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
