"""Rotations (quaternions w x y z, rigidity, the smallest rotation between two directions) and least-squares
similarities.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def matrix_from_quaternion(quaternion: ArrayLike) -> NDArray[np.float64]:
    """(..., 4) w x y z, any positive length -> (..., 3, 3) rotation matrices."""
    q = np.asarray(quaternion, dtype=np.float64)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rotation = np.empty((*w.shape, 3, 3))
    rotation[..., 0, 0] = 1 - 2 * (y * y + z * z)
    rotation[..., 0, 1] = 2 * (x * y - w * z)
    rotation[..., 0, 2] = 2 * (x * z + w * y)
    rotation[..., 1, 0] = 2 * (x * y + w * z)
    rotation[..., 1, 1] = 1 - 2 * (x * x + z * z)
    rotation[..., 1, 2] = 2 * (y * z - w * x)
    rotation[..., 2, 0] = 2 * (x * z - w * y)
    rotation[..., 2, 1] = 2 * (y * z + w * x)
    rotation[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return rotation


def rotation_angle(rotation: NDArray[np.floating]) -> float:
    """Angle of a rotation (3, 3), degrees."""
    return float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))


def is_rigid(pose: NDArray[np.float64]) -> bool:
    """Whether a (4, 4) matrix is a finite rotation (determinant +1) and translation with last row 0 0 0 1."""
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        return False
    rotation = pose[:3, :3]
    orthonormal = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3)
    return bool(orthonormal and np.linalg.det(rotation) > 0 and np.allclose(pose[3], [0, 0, 0, 1], atol=1e-6))


def smallest_rotation(source: ArrayLike, target: ArrayLike) -> NDArray[np.float64]:
    """(3, 3) float64 rotation about the origin by the smallest angle that maps the direction of `source` (3,) to
    `target` (3,)."""
    a = np.asarray(source, dtype=np.float64)
    b = np.asarray(target, dtype=np.float64)
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    cosine, v = float(a @ b), np.cross(a, b)
    sine = float(np.linalg.norm(v))
    if sine < 1e-12:
        if cosine > 0:
            return np.eye(3)
        v, sine = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))]), 0.0
    # Rodrigues with a unit axis: dividing by 1 + cosine instead loses all digits near opposite directions.
    v = v / np.linalg.norm(v)
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + sine * cross + (1 - cosine) * cross @ cross


def level_axes(up: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two horizontal unit vectors (3,) at right angles to `up` and to each other. The second is the first, rotated by a
    quarter turn about `up`."""
    east = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    east /= np.linalg.norm(east)
    return east, np.cross(up, east)


def quaternion_from_matrix(rotation: ArrayLike) -> NDArray[np.float64]:
    """(4,) unit w x y z, w >= 0, of a (3, 3) rotation matrix: the eigenvector of Bar-Itzhack's (2000) symmetric matrix
    with the largest eigenvalue."""
    m = np.asarray(rotation, dtype=np.float64)
    xx, xy, xz, yx, yy, yz, zx, zy, zz = m.reshape(-1)
    k = np.array(
        [
            [xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, xx - yy - zz, xy + yx, xz + zx],
            [xz - zx, xy + yx, yy - xx - zz, yz + zy],
            [yx - xy, xz + zx, yz + zy, zz - xx - yy],
        ]
    )
    quaternion = np.linalg.eigh(k)[1][:, -1]
    return np.asarray(quaternion if quaternion[0] >= 0 else -quaternion)


def fitted_similarity(
    source: NDArray[np.float64], target: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Scale, rotation (3, 3), and shift (3,) of the least-squares similarity from `source` (N, 3) to `target` (N, 3)
    (Umeyama 1991): scale * rotation @ source + shift."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, size, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1, 1, np.sign(np.linalg.det(u @ vt)) or 1.0])
    rotation = u * sign @ vt
    scale = float((size * sign).sum() / max((a**2).sum(), 1e-24))
    return scale, rotation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0)
