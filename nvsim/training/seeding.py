"""Selects the points of a scan that become Gaussians: more where its colors vary; and flattens them on the surface.

A plain wall has one color over meters, a bookshelf a new one every few centimeters. Seeds by the local deviation of the
colors start close to the distribution that growth would produce. A flat Gaussian covers the surface without thickness.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from nvsim.geometry.nearest_points import axes_of
from nvsim.splats.types import Gaussians

AROUND = 8
"""Number of scan points in a neighborhood, its center included."""
PLAIN = 0.03
"""Color deviation, 0 to 1, that is assumed for a plain surface."""
Float32 = NDArray[np.float32]


def _nearest(points: Float32, places: Float32) -> NDArray[np.int64]:
    # Neither option changes the result; such a tree is built in a third of the time.
    tree = cKDTree(points, compact_nodes=False, balanced_tree=False)
    return np.asarray(tree.query(places, k=min(AROUND, len(points)), workers=-1)[1])


def detail_shares(points: Float32, colors: Float32, exponent: float) -> NDArray[np.float64]:
    """(N,) the probability of each of `points` (N, 3) to become a seed: the deviation of the `colors` (N, 3) around it
    to the power of `exponent`."""
    nearest = _nearest(points, points).reshape(len(points), -1)
    deviation = colors[nearest].std(axis=1).mean(axis=1).astype(np.float64)
    weight = (PLAIN + deviation) ** exponent
    return np.asarray(weight / weight.sum())


def flatten(gaussians: Gaussians, surface: Float32, flatness: float) -> None:
    """Turns round Gaussians so that their first axis is the normal of the points `surface` (M, 3), meters, around them,
    and shortens that axis by the factor `flatness`. Does nothing if there are too few points for a normal."""
    if len(surface) < AROUND or len(gaussians) == 0:
        return
    nearest = _nearest(surface, gaussians.means)
    axes = axes_of(surface[nearest])
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]  # a rotation, no reflection
    gaussians.quats[:] = Rotation.from_matrix(axes).as_quat()[:, [3, 0, 1, 2]]
    gaussians.log_scales[:, 0] += np.float32(np.log(flatness))
