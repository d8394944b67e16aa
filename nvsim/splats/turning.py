"""Transform Gaussians to another frame, with their harmonics, and find the up axis of a splat file."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.files.opening import opened
from nvsim.files.reading import reading
from nvsim.geometry.rotation import quaternion_from_matrix, smallest_rotation
from nvsim.splats import harmonics
from nvsim.splats.types import Gaussians

_DIRECTIONS = 64


def transform_gaussians(gaussians: Gaussians, rotation: NDArray[np.floating], scale: float = 1.0) -> Gaussians:
    """Applies x -> scale * rotation @ x to means, axes, and the directions that colors depend on. `rotation` (3, 3) is
    a proper rotation, `scale` is positive. A camera transformed in the same way sees an unchanged image."""
    g, r = gaussians, np.asarray(rotation, np.float64)
    return Gaussians(
        np.ascontiguousarray(scale * (g.means.astype(np.float64) @ r.T), np.float32),
        (g.log_scales + np.float32(np.log(scale))).astype(np.float32),
        _product(quaternion_from_matrix(r), g.quats),
        g.opacity_logits,
        _turned_harmonics(g.sh, r),
    )


def _turned_harmonics(sh: NDArray[np.float32], rotation: NDArray[np.float64]) -> NDArray[np.float32]:
    """The functions of one degree become linear combinations of each other. Their values at more directions than
    functions determine the combination."""
    degree = round(sh.shape[1] ** 0.5) - 1
    directions = np.random.default_rng(0).normal(size=(_DIRECTIONS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    here = harmonics.basis(directions, degree).astype(np.float64)
    before = harmonics.basis(directions @ rotation, degree).astype(np.float64)  # rotation^-1 @ direction
    result = sh.copy()
    for l in range(1, degree + 1):
        band = slice(l * l, (l + 1) ** 2)
        mixing, *_ = np.linalg.lstsq(here[:, band], before[:, band], rcond=None)
        result[:, band] = np.einsum("jk,nkc->njc", mixing.astype(np.float32), sh[:, band])
    return result


def _product(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.float32]:
    """Products of one quaternion (4,) with many (N, 4), w x y z."""
    w, x, y, z = np.asarray(a, np.float32)
    matrix = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]], np.float32)
    return np.ascontiguousarray(b @ matrix.T, np.float32)


Up = Literal["z", "-z", "y", "-y", "x", "-x"]
UPS: tuple[Up, ...] = get_args(Up)


def up_axis(path: Path) -> Up:
    """The up axis: z if a PLY header says so, else -y, because splat files use camera axes with y down. Raises
    InputError if the file cannot be read."""
    with opened(path) as file, reading(path, "a splat file"):
        header = file.read(4096)
    return "z" if header.startswith(b"ply") and b"Vertical Axis: z" in header else "-y"


def upright(gaussians: Gaussians, up: Up) -> Gaussians:
    """The Gaussians rotated so that `up` becomes z."""
    if up == "z":
        return gaussians
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up.startswith("-") else 1.0
    if up == "-z":
        return transform_gaussians(gaussians, np.diag([1.0, -1.0, -1.0]))
    return transform_gaussians(gaussians, smallest_rotation(axis, np.array([0.0, 0.0, 1.0])))
