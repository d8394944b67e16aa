"""Camera centers and points from rays, and the rotations before them, against known ones."""

from __future__ import annotations

import numpy as np
import pycolmap
import pytest
from known_reconstruction import FOCAL, camera, facing, places_in, pose
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nvsim.poses.match_database import Pair
from nvsim.poses.positioning import average_rotations, positions_from_rays
from nvsim.poses.two_views import TwoViews, from_matches, share_of_agreeing_matches


def fitted(found: NDArray[np.float64], true: NDArray[np.float64]) -> NDArray[np.float64]:
    """`found` (N, 3) in the unit and at the origin of `true`; the axes are the same."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    return np.asarray((a * b).sum() / (a**2).sum() * a + true.mean(axis=0))


def scene(count: int = 30) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Cameras on a curve (I, 3), points (P, 3), and which image shows which point: only a few images in a row do."""
    rng = np.random.default_rng(0)
    angle = np.linspace(0, 4, count)
    centers = np.stack([3 * np.cos(angle), 3 * np.sin(angle), 0.2 * np.sin(5 * angle)], axis=1)
    image: list[int] = []
    point: list[int] = []
    points: list[NDArray[np.float64]] = []
    for first in range(count - 3):
        for _ in range(25):
            shown = range(first, min(count, first + int(rng.integers(3, 8))))
            image += shown
            point += [len(points)] * len(shown)
            points.append(centers[first] * rng.uniform(1.5, 3.5) + rng.normal(0, 1.0, 3))
    return centers, np.array(points), np.array(image), np.array(point)


@pytest.mark.parametrize(("noise", "wrong", "error"), [(0.0, 0.0, 0.002), (0.001, 0.0, 0.06), (0.001, 0.1, 0.5)])
def test_positions_follow_from_rays_without_initial_values(noise: float, wrong: float, error: float) -> None:
    centers, points, image, point = scene()
    rng = np.random.default_rng(1)
    rays = points[point] - centers[image]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rays += rng.normal(0, noise, rays.shape)
    outliers = rng.random(len(rays)) < wrong
    rays[outliers] += rng.normal(0, 0.3, (outliers.sum(), 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    found, placed = positions_from_rays(image, point, rays)
    assert np.linalg.norm(fitted(found, centers) - centers, axis=1).max() < error
    ahead = ((placed[point] - found[image]) * rays).sum(axis=1)
    assert (ahead[~outliers] > 0.4).all() and found.shape == centers.shape and placed.shape == points.shape


def test_rotations_agree_with_most_relative_poses() -> None:
    rng = np.random.default_rng(2)
    true = Rotation.random(12, rng).as_matrix()
    views: dict[Pair, TwoViews] = {}
    for i in range(12):
        for j in range(i + 1, min(12, i + 4)):
            noise = Rotation.from_rotvec(rng.normal(0, 0.002, 3)).as_matrix()
            turn = true[j] @ true[i].T @ (noise if (i, j) != (4, 6) else Rotation.from_rotvec([0, 0.4, 0]).as_matrix())
            plain = from_matches(np.zeros((50, 2), np.uint32))
            views[i, j] = TwoViews(turn, plain.matches, False, plain.geometry)
    found = average_rotations(views)
    assert sorted(found) == list(range(12))
    world = found[0].T @ true[0]
    for i in range(12):
        assert np.degrees(Rotation.from_matrix(found[i] @ world @ true[i].T).magnitude()) < 1.0


@pytest.mark.parametrize("step", [0.0, 0.3])
def test_matches_agree_with_the_true_pose_and_not_with_others(step: float) -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform([2, -2, -1], [6, 2, 1], (800, 3))
    ahead = facing(np.array([1.0, 0, 0]))
    cameras = [pose(ahead, np.zeros(3)), pose(facing(np.array([1, 0.05, 0])), np.array([0, step, 0]))]
    places, shown = zip(*(places_in(one, points) for one in cameras), strict=True)
    both = np.flatnonzero(shown[0] & shown[1]).astype(np.uint32)
    matches = np.stack([both, both], axis=1)
    true = cameras[1] * cameras[0].inverse()

    def share(relative: pycolmap.Rigid3d) -> float:
        return share_of_agreeing_matches(relative, (camera(), camera()), (places[0], places[1]), matches, 0.5)

    assert share(true) == 1.0
    other = pycolmap.Rigid3d(pycolmap.Rotation3d(Rotation.from_euler("y", 8, degrees=True).as_matrix()), np.zeros(3))
    assert share(other * true) < 0.5
    assert share(pycolmap.Rigid3d(true.rotation, -true.translation)) < (0.1 if step else 1.1)  # behind both cameras
    assert FOCAL * step / 6 > 4 or step == 0.0  # so that no ray is parallel
