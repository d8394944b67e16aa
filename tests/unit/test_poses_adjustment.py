"""Cameras and points that are adjusted together, on points that are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_info, threadpool_limits

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.poses.adjustment import _AdjustmentState, adjust
from nvsim.poses.features import Features, match_features
from nvsim.poses.refinement import epipolar_distances, pairs_to_compare
from nvsim.poses.tracks import Tracks, tracks_of

K = Intrinsics(640, 480, 500.0, 490.0, 318.0, 243.0)


def walk(count: int = 24) -> list[Camera]:
    """Cameras a hand's breadth apart that look at a wall, swaying."""
    places = [np.array([0.15 * i, 0.05 * np.sin(i), 1.5]) for i in range(count)]
    return [Camera(K, camera_pose(place, 0.1 * np.sin(0.7 * i), -0.1)) for i, place in enumerate(places)]


def shaken(cameras: list[Camera], meters: float = 0.012, degrees: float = 0.25, seed: int = 0) -> list[Camera]:
    rng = np.random.default_rng(seed)
    found = []
    for camera in cameras:
        pose = camera.camera_to_world.copy()
        pose[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(np.radians(rng.normal(0, degrees, 3))).as_matrix()
        pose[:3, 3] += rng.normal(0, meters, 3)
        found.append(Camera(K, pose))
    return found


def seen(cameras: list[Camera], noise: float = 0.2, wrong: float = 0.0) -> Tracks:
    """What the cameras show of 600 points two to four meters away; a share of it is `wrong`."""
    rng = np.random.default_rng(1)
    points = rng.uniform((-1.5, 2.0, 0.3), (5.0, 4.0, 2.8), (600, 3))
    lines: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []
    for number, camera in enumerate(cameras):
        pixels, depth = camera.project(points)
        inside = (depth > 0.5) & (pixels > 0).all(axis=1) & (pixels < (K.width, K.height)).all(axis=1)
        place = pixels[inside] + rng.normal(0, noise, (int(inside.sum()), 2))
        astray = rng.random(len(place)) < wrong
        place[astray] += rng.uniform(-60, 60, (int(astray.sum()), 2))
        lines.append((np.flatnonzero(inside), np.full(len(place), number), place))
    point, frame, places = (np.concatenate(part) for part in zip(*lines, strict=True))
    return Tracks(np.unique(point, return_inverse=True)[1].astype(np.int64), frame.astype(np.int64), places)


def jitter(poses: NDArray[np.float64], cameras: list[Camera]) -> tuple[float, float]:
    """Errors of the steps from camera to camera, in meters and degrees, by which images disagree."""
    true = np.stack([c.camera_to_world for c in cameras])
    off = np.diff(poses[:, :3, 3] - true[:, :3, 3], axis=0)
    turned = Rotation.from_matrix(true[:, :3, :3].transpose(0, 2, 1) @ poses[:, :3, :3])
    return float(np.median(np.linalg.norm(off, axis=1))), float(np.degrees(np.median(turned.magnitude())))


@pytest.mark.parametrize("wrong", [0.0, 0.15])
def test_what_a_hand_shakes_is_taken_back_although_matches_are_wrong(wrong: float) -> None:
    cameras = walk()
    given = shaken(cameras)
    found = adjust(given, seen(cameras, wrong=wrong))
    before, after = jitter(np.stack([c.camera_to_world for c in given]), cameras), jitter(found.poses, cameras)
    assert after[0] < 0.3 * before[0] and after[1] < 0.6 * before[1]
    assert found.before > 1.5 and found.after < 0.35
    turned = found.poses[:, :3, :3]
    np.testing.assert_allclose(turned @ turned.transpose(0, 2, 1), np.tile(np.eye(3), (len(cameras), 1, 1)), atol=1e-9)


def test_the_products_of_an_adjustment_use_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    run_round, threads = _AdjustmentState.run_round, set[int]()

    def counted(state: _AdjustmentState, astray: float) -> float:
        threads.update(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")
        return run_round(state, astray)

    monkeypatch.setattr(_AdjustmentState, "run_round", counted)
    with threadpool_limits(2, "blas"):
        adjust(shaken(walk(4)), seen(walk(4)))
    assert threads == {1}


def test_the_capture_as_a_whole_stays_where_it_was() -> None:
    cameras = walk()
    given = shaken(cameras)
    moved = adjust(given, seen(cameras)).poses[:, :3, 3] - np.stack([c.position for c in given])
    assert np.linalg.norm(moved.mean(axis=0)) < 0.01


def test_a_camera_that_shares_nothing_keeps_its_pose() -> None:
    cameras = [*walk(), Camera(K, camera_pose(np.array([9.0, -5.0, 1.5]), np.pi))]
    given = shaken(cameras)
    tracks = seen(cameras[:-1])
    np.testing.assert_allclose(adjust(given, tracks).poses[-1], given[-1].camera_to_world, atol=1e-12)
    with pytest.raises(ValueError, match="no track"):
        adjust(given, Tracks(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2))))


def test_the_equations_are_the_derivatives_of_what_is_off() -> None:
    cameras = walk(4)
    tracks = seen(cameras)
    work = _AdjustmentState(shaken(cameras), tracks)
    local, off, far, counts = work.errors(12.0)
    matrix, _, points = work._equations(local, off, np.zeros_like(far), counts)  # no weights
    rng = np.random.default_rng(2)
    step = rng.normal(0, 1e-6, matrix.shape[1])
    work.poses[:, :3, :3] = work.poses[:, :3, :3] @ Rotation.from_rotvec(step[:24].reshape(4, 6)[:, :3]).as_matrix()
    work.poses[:, :3, 3] += step[:24].reshape(4, 6)[:, 3:]
    work._points[points] += step[24:].reshape(-1, 3)
    change = (work.errors(12.0)[1] - off)[counts].ravel()
    np.testing.assert_allclose((matrix @ step)[: len(change)], change, atol=1e-7 * 5)


def test_a_feature_of_the_same_point_lies_on_its_epipolar_line_and_one_beside_it_is_as_far_off() -> None:
    first, second = walk()[0], walk()[3]
    points = np.random.default_rng(3).uniform((-0.5, 2.5, 1.0), (0.8, 4.0, 2.0), (50, 3))
    a, b = first.project(points)[0], second.project(points)[0]
    np.testing.assert_allclose(epipolar_distances(a, b, first, second), 0, atol=1e-9)
    # The camera went to the right, so that epipolar lines are nearly level: up is off them, in one of two images.
    off = np.abs(epipolar_distances(a, b + (0.0, 2.0), first, second))
    np.testing.assert_allclose(off, 2 / np.sqrt(2), rtol=0.1)


def test_pairs_are_near_look_the_same_way_and_each_is_named_once() -> None:
    poses = np.stack([c.camera_to_world for c in [*walk(), Camera(K, camera_pose(np.array([1.0, 0, 1.5]), np.pi))]])
    pairs = pairs_to_compare(poses)
    assert len(set(pairs)) == len(pairs) and all(i < j < len(poses) - 1 for i, j in pairs)
    assert max(np.linalg.norm(poses[i, :3, 3] - poses[j, :3, 3]) for i, j in pairs) < 1.5
    assert {i for pair in pairs for i in pair} == set(range(len(poses) - 1))


def test_tracks_follow_matches_through_images_and_forget_what_contradicts_itself() -> None:
    features = [Features(np.arange(8.0).reshape(4, 2) + 10 * i, np.zeros((4, 128), np.uint8)) for i in range(3)]
    pairs, one = [(0, 1), (1, 2), (0, 2)], np.array([[0, 1], [2, 2]])
    # Feature 2 of the first image would be two features of the third.
    tracks = tracks_of(features, pairs, [one, np.array([[1, 3], [2, 0]]), np.array([[2, 1]])])
    assert tracks.points == 1 and tracks.frame.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(tracks.places, [[0, 1], [12, 13], [26, 27]])
    assert tracks_of(features, pairs, [one[:0]] * 3).points == 0


def test_only_what_is_clearly_alike_is_matched() -> None:
    rng = np.random.default_rng(4)
    known = rng.integers(0, 256, (40, 128)).astype(np.uint8)
    other = np.clip(known[::-1].astype(int) + rng.integers(-6, 7, known.shape), 0, 255).astype(np.uint8)
    other[5] = other[6]  # two that are the same: neither is clear
    places = np.zeros((40, 2))
    found = {(int(a), int(b)) for a, b in match_features(Features(places, known), Features(places, other))}
    # That which the sixth was made of has no counterpart any more, and that of the seventh has two.
    assert found == {(39 - b, b) for b in range(40)} - {(34, 5), (33, 6)}
