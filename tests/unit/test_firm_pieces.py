"""A reconstruction is cut where its images hold together too loosely."""

from __future__ import annotations

import numpy as np
import pycolmap
import pytest
from known_reconstruction import FOCAL, center_of, facing, pose, reconstruction, seen_from
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nvsim.poses.piece_reliability import (
    Observations,
    firmly_connected_pieces,
    observations_of,
    scale_deviation,
    uncertain_images,
)

AHEAD = np.array([0.0, 1.0, 0.0])


def numeric_deviation(seen: Observations, other: NDArray[np.bool_]) -> float:
    """The same by finite differences of all pixels by the similarity of the `other` images and by all points."""
    count = len(seen.places)

    def pixels(flat: NDArray[np.float64]) -> NDArray[np.float64]:
        scale, turn, move = np.exp(flat[0]), Rotation.from_rotvec(flat[1:4]).as_matrix(), flat[4:7]
        points = seen.places + flat[7:].reshape(-1, 3)
        moves = other[seen.image]
        rotation = seen.rotation[seen.image].copy()
        center = seen.center[seen.image].copy()
        rotation[moves] = rotation[moves] @ turn.T
        center[moves] = scale * center[moves] @ turn.T + move
        local = np.einsum("nij,nj->ni", rotation, points[seen.point] - center)
        return np.asarray(FOCAL * local[:, :2] / local[:, 2:]).ravel()

    size, step = 7 + 3 * count, 1e-6
    slope = np.stack([(pixels(d) - pixels(-d)) / (2 * step) for d in np.eye(size) * step], axis=1)
    return float(np.sqrt(np.linalg.inv(slope.T @ slope)[0, 0]))


def small_scene(seed: int, shift: float) -> pycolmap.Reconstruction:
    """Four images from one side of a cloud of points and four from another."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((-1.5, 2.5, -1), (1.5, 5, 1), (40, 3))
    poses = {}
    for k in range(8):
        center = np.array([(shift if k >= 4 else 0) + 0.2 * (k % 4), 0.1 * rng.normal(), 0.1 * rng.normal()])
        poses[k + 1] = pose(facing(AHEAD + 0.1 * rng.normal(size=3)), center)
    shown_by, places = seen_from(poses, points)
    return reconstruction(poses, points, shown_by, places)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("shift", [0.9, -1.5])
def test_scale_deviation_is_that_of_finite_differences(seed: int, shift: float) -> None:
    seen = observations_of(small_scene(seed, shift))
    other = np.arange(8) >= 4
    found = scale_deviation(seen, ~other, other)
    assert found == pytest.approx(numeric_deviation(seen, other), rel=1e-3)
    assert scale_deviation(seen, other, ~other) == pytest.approx(found, rel=1e-6)
    assert scale_deviation(seen, ~other, other, pixel=0.5) == pytest.approx(found / 2)


def test_scale_deviation_is_infinite_without_enough_common_points() -> None:
    model = small_scene(0, 0.9)
    other = np.arange(8) >= 4
    for number in list(model.points3D)[2:]:
        model.delete_point3D(number)
    assert scale_deviation(observations_of(model), ~other, other) == np.inf


def test_fewer_common_points_hold_less_firmly() -> None:
    model, other, found = small_scene(1, 0.9), np.arange(8) >= 4, []
    for left in (30, 20, 10):
        for number in list(model.points3D)[left:]:
            model.delete_point3D(number)
        found.append(scale_deviation(observations_of(model), ~other, other))
    assert found[0] < found[1] < found[2]


HALF = 60
TIMES = np.arange(2.0 * HALF)
UNORDERED = np.zeros(0)


def there_and_back(common: int, returned: bool) -> pycolmap.Reconstruction:
    """A camera moves along a wall and back. On the way back it sees points of its own, besides `common` points near
    the turn. If it `returned`, its last 15 images see the points of the first ones."""
    rng = np.random.default_rng(5)
    poses = {}
    for k in range(2 * HALF):
        x = 0.12 * (k if k < HALF else 2 * HALF - k)
        center = np.array([x, -0.4 * np.clip((k - HALF) / 8, 0, 1), 0.05 * np.sin(k)])
        poses[k + 1] = pose(facing(AHEAD + [0.1 * np.sin(0.3 * k), 0, 0]), center)
    points = rng.uniform((-2, 2, -1.2), (9.5, 4, 1.2), (1000, 3))
    there = np.arange(len(points)) < 500
    shown_by, _ = seen_from(poses, points)
    turn = np.intersect1d(shown_by[HALF][there[shown_by[HALF]]], shown_by[HALF + 1])[:common]
    kept = {}
    for number, shown in shown_by.items():
        own = there[shown] if number <= HALF else ~there[shown]
        if abs(number - HALF - 0.5) < (2 if common < 10 else 4):
            own |= np.isin(shown, turn)
        if returned and number > 2 * HALF - 15:
            own |= there[shown]
        kept[number] = shown[own]
    places = {number: np.zeros((len(shown), 2)) for number, shown in kept.items()}
    return reconstruction(poses, points, kept, places)


def whole(piece: list[int], expected: range) -> bool:
    """Whether a piece is these images; beside a cut, where few images are on one side, two may be missing."""
    return set(range(expected.start + 2, expected.stop - 2)) <= set(piece) <= set(expected)


def test_images_that_share_many_points_are_one_piece_from_the_first_to_the_last() -> None:
    assert firmly_connected_pieces(there_and_back(400, False), TIMES) == [list(range(1, 2 * HALF + 1))]


def test_two_groups_joined_by_few_points_are_cut() -> None:
    pieces = firmly_connected_pieces(there_and_back(2, False), TIMES)
    assert sorted(n for piece in pieces for n in piece) == list(range(1, 2 * HALF + 1))
    first, second = sorted(pieces[:2])
    assert whole(first, range(1, HALF + 1)) and whole(second, range(HALF + 1, 2 * HALF + 1))


@pytest.mark.parametrize(("far", "pieces"), [(0.05, 1), (2.0, 2)])
def test_a_video_is_cut_if_the_camera_jumps(far: float, pieces: int) -> None:
    model = there_and_back(400, False)
    for number in range(HALF + 1, 2 * HALF + 1):
        model.images[number].frame.rig_from_world = pycolmap.Rigid3d(
            model.images[number].cam_from_world().rotation,
            model.images[number].cam_from_world().translation
            - model.images[number].cam_from_world().rotation.matrix() @ np.array([0, 0, far]),
        )
    found = firmly_connected_pieces(model, TIMES)
    assert len(found) == pieces
    if pieces == 2:
        assert {len(piece) for piece in found} == {HALF}


@pytest.mark.parametrize(("step", "unsure"), [(1.0, 0), (2.5, 10)])
def test_a_stretch_with_an_open_end_and_a_fast_step_at_the_other_is_unsure(step: float, unsure: int) -> None:
    model = there_and_back(2, False)
    usual = np.linalg.norm(model.images[5].projection_center() - model.images[6].projection_center())
    for number in range(HALF + 1, HALF + 11):
        turn = model.images[number].cam_from_world().rotation
        back = model.images[number].projection_center() - [0, 0, (step**2 - 1) ** 0.5 * usual]
        model.images[number].frame.rig_from_world = pycolmap.Rigid3d(turn, -turn.matrix() @ back)
    found = uncertain_images(model, TIMES)
    assert len(found) == pytest.approx(unsure, abs=2 if unsure else 0)
    assert found <= set(range(HALF - 1, HALF + 11))


def test_groups_that_share_points_elsewhere_are_one_again() -> None:
    missing = set(range(1, 2 * HALF + 1)) - set(firmly_connected_pieces(there_and_back(2, True), TIMES)[0])
    assert all(abs(n - HALF - 0.5) < 3 for n in missing)


def test_photographs_are_cut_where_few_points_reach_in_whatever_order_they_are() -> None:
    pieces = firmly_connected_pieces(there_and_back(2, False), UNORDERED)
    assert sorted(n for piece in pieces for n in piece) == list(range(1, 2 * HALF + 1))
    assert len(pieces) > 1 and len(pieces[0]) >= len(pieces[-1])
    assert firmly_connected_pieces(small_scene(0, 0.9), UNORDERED) == [list(range(1, 9))]


def test_observations_are_those_of_the_model() -> None:
    model = small_scene(0, 0.9)
    seen = observations_of(model)
    assert seen.numbers.tolist() == list(range(1, 9)) and len(seen.places) == len(model.points3D)
    assert np.allclose(seen.center[2], center_of(model.images[3].cam_from_world())) and (seen.focal == FOCAL).all()
    local = np.einsum("nij,nj->ni", seen.rotation[seen.image], seen.places[seen.point] - seen.center[seen.image])
    assert (local[:, 2] > 0).all() and len(seen.image) == sum(p.track.length() for p in model.points3D.values())
