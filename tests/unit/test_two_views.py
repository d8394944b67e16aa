"""The relative pose of two images with known cameras, on points that are known."""

from __future__ import annotations

import numpy as np
import pytest
from known_reconstruction import HEIGHT, WIDTH, angle_between, camera, places_in, pose, turned
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nvsim.poses.two_views import from_matches, rays_of, relative_pose, rotation_between

TURN = turned(9, (0.2, 1.0, 0.1))
Places = NDArray[np.float64]


def two_images(
    rotation: NDArray[np.float64], center: tuple[float, float, float], wrong: float = 0.0, noise: float = 0.3
) -> tuple[tuple[Places, Places], NDArray[np.uint32], NDArray[np.bool_]]:
    """Keypoints of two images of a room, their matches, and which of these are right. The second image is at
    `center`; points are 1.5 to 8 m away."""
    rng = np.random.default_rng(4)
    depth = rng.uniform(1.5, 8, 900)
    points = np.column_stack([rng.uniform(-0.7, 0.7, (900, 2)) * depth[:, None] * (1, 0.7), depth])
    one, first = places_in(pose(np.eye(3), np.zeros(3)), points)
    other, second = places_in(pose(rotation, np.array(center)), points)
    both = np.flatnonzero(first & second)[:300]
    assert len(both) == 300
    one, other = (p[both] + rng.normal(0, noise, (300, 2)) for p in (one, other))
    right = rng.random(300) >= wrong
    other[~right] = rng.uniform(0, (WIDTH, HEIGHT), ((~right).sum(), 2))
    order = rng.permutation(300)  # keypoints of the second image are in another order than those of the first
    matches = np.stack([np.arange(300), np.argsort(order)], axis=1).astype(np.uint32)
    return (one, other[order]), matches, right


@pytest.mark.parametrize("wrong", [0.0, 0.4])
def test_a_camera_that_only_turns_gives_the_rotation(wrong: float) -> None:
    places, matches, right = two_images(TURN, (0, 0, 0), wrong)
    found = relative_pose((camera(), camera()), places, matches)
    assert found is not None and found.turned
    assert angle_between(found.rotation, TURN) < 0.05
    agreed = np.isin(matches[:, 0], found.matches[:, 0])
    assert agreed[right].mean() > 0.95 and (agreed & ~right).sum() < 0.1 * right.sum()


@pytest.mark.parametrize("wrong", [0.0, 0.4])
def test_a_camera_that_moves_gives_the_essential_matrix(wrong: float) -> None:
    places, matches, right = two_images(TURN, (0.5, 0.1, 0.2), wrong)
    found = relative_pose((camera(), camera()), places, matches)
    assert found is not None and not found.turned
    assert angle_between(found.rotation, TURN) < 0.3
    agreed = np.isin(matches[:, 0], found.matches[:, 0])
    assert agreed[right].mean() > 0.9
    pose_found = found.geometry.cam2_from_cam1
    assert pose_found is not None
    expected = -TURN @ [0.5, 0.1, 0.2]
    cosine = pose_found.translation @ expected / np.linalg.norm(expected) / np.linalg.norm(pose_found.translation)
    assert np.degrees(np.arccos(min(1.0, cosine))) < 5


def test_a_move_by_a_centimeter_counts_as_a_turn() -> None:
    places, matches, _ = two_images(TURN, (0.01, 0, 0))
    found = relative_pose((camera(), camera()), places, matches)
    assert found is not None and found.turned
    assert angle_between(found.rotation, TURN) < 0.3


def test_too_few_or_only_wrong_matches_give_nothing() -> None:
    places, matches, _ = two_images(TURN, (0.5, 0, 0))
    assert relative_pose((camera(), camera()), places, matches[:10]) is None
    assert relative_pose((camera(), camera()), places, matches[:0]) is None
    places, matches, _ = two_images(TURN, (0, 0, 0), wrong=1.0)
    assert relative_pose((camera(), camera()), places, matches[:60]) is None


def test_the_result_is_the_same_each_time() -> None:
    places, matches, _ = two_images(TURN, (0.5, 0.1, 0.2), 0.4)
    one, other = (relative_pose((camera(), camera()), places, matches) for _ in range(2))
    assert one is not None and other is not None
    assert np.array_equal(one.rotation, other.rotation) and np.array_equal(one.matches, other.matches)


def test_rotation_is_the_least_squares_rotation_of_exact_rays() -> None:
    rng = np.random.default_rng(2)
    one = rng.normal(size=(80, 3)) * (0.4, 0.4, 0.1) + (0, 0, 1)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other = one @ TURN.T + rng.normal(0, 2e-4, one.shape)
    other /= np.linalg.norm(other, axis=1, keepdims=True)
    closed, _ = Rotation.align_vectors(other, one)
    assert angle_between(rotation_between(one, other, 0.01), closed.as_matrix()) < 1e-3


def test_rotation_ignores_rays_that_most_contradict() -> None:
    rng = np.random.default_rng(3)
    one = rng.normal(size=(200, 3))
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other = one @ TURN.T
    other[:100] = rng.normal(size=(100, 3))
    other /= np.linalg.norm(other, axis=1, keepdims=True)
    found = rotation_between(one, other, 0.01)
    assert angle_between(found, TURN) < 0.02
    assert np.allclose(found @ found.T, np.eye(3)) and np.linalg.det(found) == pytest.approx(1)


def test_rays_project_to_their_pixels() -> None:
    own = camera()
    own.params = [500.0, WIDTH / 2, HEIGHT / 2, 0.08]
    places = np.array([[WIDTH / 2, HEIGHT / 2], [10, 20], [600, 400]])
    rays = rays_of(own, places)
    assert np.allclose(np.linalg.norm(rays, axis=1), 1) and np.allclose(rays[0], [0, 0, 1])
    assert np.allclose(own.img_from_cam(rays), places, atol=1e-4)


def test_matches_without_a_pose_are_kept() -> None:
    matches = np.array([[1, 2], [3, 4]], np.uint32)
    found = from_matches(matches)
    assert found.turned and np.array_equal(found.geometry.inlier_matches, matches)
