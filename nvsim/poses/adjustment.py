"""Bundle adjustment of cameras and points that keeps cameras near their given poses.

It minimizes the distances between features and projected points (Triggs et al. 2000, Bundle Adjustment - A Modern
Synthesis). A prior holds each camera near its given pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.poses.threads import one_thread_of_blas
from nvsim.poses.tracks import Tracks

Float = NDArray[np.float64]
_POSITION, _ROTATION = 0.02, np.radians(0.4)  # standard deviations of the given poses: meters, radians
_PIXEL = 1.0  # usual reprojection error of a feature, pixels
_ROBUST = 1.5  # scale of the robust weight, in units of _PIXEL
_ASTRAY = (12.0, 6.0)  # pixels: features with a larger error are ignored, in the first two rounds and later
_ROUNDS, _STEPS = 12, 150  # Gauss-Newton rounds, and LSMR iterations in each
_SMALL = 2e-4  # meters: adjustment stops when no camera moves farther
_FLAT = 1e-4  # smallest eigenvalue of a point's ray equations over the largest; below it, the point has no parallax
_NEAREST = 0.1  # meters in front of a camera
_LONGEST = 1.0  # meters that a point may move in a round


@dataclass(frozen=True, eq=False)
class AdjustedPoses:
    """poses     (N, 4, 4) float64, camera to world
    before    median reprojection error with the given poses and points triangulated from them, pixels
    after     median reprojection error with the adjusted poses and points, pixels
    features  (N,) int64, features of each frame that are used in the end
    """

    poses: Float
    before: float
    after: float
    features: NDArray[np.int64]


def adjust(cameras: Sequence[Camera], tracks: Tracks) -> AdjustedPoses:
    """Adjusts the poses of `cameras` (one for each frame) to `tracks`; pixels and meters. A camera without features
    keeps its pose. Raises ValueError if there is no track."""
    if not len(tracks.point):
        raise ValueError("there is no track")
    work = _AdjustmentState(cameras, tracks)
    with one_thread_of_blas():
        errors = [work.run_round(_ASTRAY[0 if number < 2 else 1]) for number in range(_ROUNDS) if not work.is_done]
    _, _, _, counts = work.errors(_ASTRAY[1])
    features = np.bincount(tracks.frame[counts], minlength=len(cameras))
    return AdjustedPoses(work.poses, errors[0], work.error(_ASTRAY[1]), features)


class _AdjustmentState:
    """Poses and points during the adjustment."""

    def __init__(self, cameras: Sequence[Camera], tracks: Tracks) -> None:
        self._tracks, self._count = tracks, len(cameras)
        self._given = np.stack([c.camera_to_world for c in cameras]).astype(np.float64)
        self.poses = self._given.copy()
        k = np.array([(c.intrinsics.fx, c.intrinsics.fy, c.intrinsics.cx, c.intrinsics.cy) for c in cameras])
        self._focal, self._middle = k[tracks.frame, :2], k[tracks.frame, 2:]
        self._points, known = self._triangulate()
        self._known = known[tracks.point]
        self.is_done = False

    def _triangulate(self) -> tuple[Float, NDArray[np.bool_]]:
        """Points (P, 3) nearest to the rays of their features, and (P,) bool: whether the rays have parallax."""
        frame, point, count = self._tracks.frame, self._tracks.point, self._tracks.points
        local = np.hstack([(self._tracks.places - self._middle) / self._focal, np.ones((len(frame), 1))])
        rays = np.einsum("nij,nj->ni", self.poses[frame, :3, :3], local)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
        normal, target = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(normal, point, across)
        np.add.at(target, point, np.einsum("nij,nj->ni", across, self.poses[frame, :3, 3]))
        certain = np.linalg.eigvalsh(normal)
        known = certain[:, 0] > _FLAT * certain[:, 2]
        points = np.zeros((count, 3))
        points[known] = np.linalg.solve(normal[known], target[known][..., None])[..., 0]
        return points, known

    def errors(self, astray: float) -> tuple[Float, Float, Float, NDArray[np.bool_]]:
        """Reprojection errors of all N observations of the tracks.

        Returns the points in the camera frames (N, 3) in meters, the errors (N, 2) in pixels, their lengths (N,), and
        (N,) bool: whether the observation is used. Observations with an error above `astray` pixels are not used."""
        frame, point = self._tracks.frame, self._tracks.point
        away = self._points[point] - self.poses[frame, :3, 3]
        local = np.einsum("nji,nj->ni", self.poses[frame, :3, :3], away)
        depth = np.maximum(local[:, 2:], _NEAREST)
        off = self._focal * local[:, :2] / depth + self._middle - self._tracks.places
        far = np.linalg.norm(off, axis=1)
        counts = self._known & (local[:, 2] > _NEAREST) & (far < astray)
        counts &= np.bincount(point[counts], minlength=self._tracks.points)[point] > 1
        return local, off, far, counts

    def error(self, astray: float) -> float:
        """Median error of the observations that are used, pixels."""
        _, _, far, counts = self.errors(astray)
        return float(np.median(far[counts])) if counts.any() else float("inf")

    def run_round(self, astray: float) -> float:
        """Moves cameras and points once. Returns the median error before the move, pixels."""
        from scipy.sparse.linalg import lsmr
        from scipy.spatial.transform import Rotation

        local, off, far, counts = self.errors(astray)
        if not counts.any():
            self.is_done = True
            return float("inf")
        matrix, right, points = self._equations(local, off, far, counts)
        # Columns scaled to the same length: LSMR needs a tenth of the iterations.
        scale = 1 / np.sqrt(np.maximum(np.asarray(matrix.multiply(matrix).sum(axis=0)).ravel(), 1e-18))
        found = lsmr(matrix.multiply(scale[None]).tocsr(), right, damp=1e-3, atol=1e-5, btol=1e-5, maxiter=_STEPS)[0]
        found *= scale
        moves = found[: 6 * self._count].reshape(-1, 6)
        self.poses[:, :3, :3] = self.poses[:, :3, :3] @ Rotation.from_rotvec(moves[:, :3]).as_matrix()
        self.poses[:, :3, 3] += moves[:, 3:]
        self._points[points] += np.clip(found[6 * self._count :].reshape(-1, 3), -_LONGEST, _LONGEST)
        self.is_done = bool(np.abs(moves[:, 3:]).max() < _SMALL)
        return float(np.median(far[counts]))

    def _equations(
        self, local: Float, off: Float, far: Float, counts: NDArray[np.bool_]
    ) -> tuple[Any, Float, NDArray[np.int64]]:
        """The sparse linear equations of a round, their right side, and the indices of their points.

        There are two equations for each used observation and six prior equations for each camera. The unknowns are
        the rotation (in the camera frame) and position of each camera, then the positions of the returned points."""
        from scipy.sparse import csr_matrix, vstack
        from scipy.spatial.transform import Rotation

        rows = np.flatnonzero(counts)
        frame, size, local = self._tracks.frame[rows], len(rows), local[rows]
        points, column = np.unique(self._tracks.point[rows], return_inverse=True)
        x, y, z = local.T
        seen = np.zeros((size, 2, 3))  # derivative of pixels by points in the camera frame
        seen[:, 0, 0], seen[:, 1, 1] = self._focal[rows].T / z
        seen[:, 0, 2], seen[:, 1, 2] = -seen[:, 0, 0] * x / z, -seen[:, 1, 1] * y / z
        turned = np.zeros((size, 3, 3))  # derivative of these points by rotations of the camera
        turned[:, 0, 1], turned[:, 0, 2], turned[:, 1, 2] = -z, y, -x
        turned -= turned.transpose(0, 2, 1)
        by_point = seen @ self.poses[frame, :3, :3].transpose(0, 2, 1)
        weight = 1 / np.sqrt(1 + (far[rows] / (_ROBUST * _PIXEL)) ** 2) / _PIXEL
        values = np.concatenate([seen @ turned, -by_point, by_point], axis=2) * weight[:, None, None]
        camera = 6 * frame[:, None] + np.arange(6)
        columns = np.concatenate([camera, 6 * self._count + 3 * column[:, None] + np.arange(3)], axis=1)
        width = 6 * self._count + 3 * len(points)
        where = np.repeat(np.arange(2 * size), 9), np.repeat(columns[:, None], 2, axis=1).ravel()
        shown = csr_matrix((values.ravel(), where), shape=(2 * size, width))
        firm = np.tile([1 / _ROTATION] * 3 + [1 / _POSITION] * 3, self._count)
        held = csr_matrix((firm, (np.arange(len(firm)), np.arange(len(firm)))), shape=(len(firm), width))
        since = Rotation.from_matrix(self._given[:, :3, :3].transpose(0, 2, 1) @ self.poses[:, :3, :3]).as_rotvec()
        moved = np.concatenate([since, self.poses[:, :3, 3] - self._given[:, :3, 3]], axis=1)
        right = -np.concatenate([(off[rows] * weight[:, None]).ravel(), moved.ravel() * firm])
        return vstack([shown, held]).tocsr(), right, points
