"""Pieces of a reconstruction join by points that look alike; a similarity that cannot be true is refused."""

from __future__ import annotations

import numpy as np
import pycolmap
from known_reconstruction import center_of, facing, pose, reconstruction, seen_from
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nvsim.poses.features import Features
from nvsim.poses.joining import PosePiece, join, piece_of
from nvsim.poses.match_database import Keypoints

APART = pycolmap.Sim3d(0.4, pycolmap.Rotation3d(Rotation.from_euler("xyz", [0.3, -0.8, 1.1]).as_matrix()), [3, -2, 1.0])
"""How the second piece of the tests lies from where it should be."""
ONE_VIDEO = np.zeros(60, np.int64)
PACE = 0.15  # meters from image to image


def walk(count: int = 40) -> dict[int, pycolmap.Rigid3d]:
    ahead = np.array([0.0, 1.0, 0.0])
    return {
        k + 1: pose(facing(ahead + [0.1 * np.sin(k), 0, 0]), np.array([PACE * k, 0.3 * np.sin(0.4 * k), 0.0]))
        for k in range(count)
    }


def piece(
    poses: dict[int, pycolmap.Rigid3d],
    first: int,
    last: int,
    looks: NDArray[np.int64],
    noise: float = 0.0,
    points: NDArray[np.float64] | None = None,
) -> PosePiece:
    """Images `first` to `last`. It has a point for each of `looks` (rows of a table of random descriptors), at
    `points`, or where the number of the look says."""
    rng = np.random.default_rng(first)
    places = np.random.default_rng(0).uniform((0, 2, -1.5), (6, 5, 1.5), (1000, 3))[looks] if points is None else points
    table = np.random.default_rng(1).random((1000, 128)).astype(np.float32) ** 4
    table /= np.linalg.norm(table, axis=1, keepdims=True)
    numbers = np.arange(first, last + 1)
    seen = [[(int(numbers[k % len(numbers)]), k), (int(numbers[(k + 1) % len(numbers)]), k)] for k in range(len(looks))]
    moved = places + rng.normal(0, noise, places.shape)
    return PosePiece(numbers, {int(n): poses[int(n)] for n in numbers}, moved, table[looks], seen)


def numbers(first: int, last: int) -> NDArray[np.int64]:
    return np.arange(first, last)


def assert_at(found: dict[int, pycolmap.Rigid3d], true: dict[int, pycolmap.Rigid3d], off: float) -> None:
    for n, one in found.items():
        assert np.linalg.norm(center_of(one) - center_of(true[n])) < off, n
        assert np.abs(one.rotation.matrix() - true[n].rotation.matrix()).max() < off, n


def test_two_pieces_of_a_known_similarity_join_exactly() -> None:
    poses = walk()
    base, other = piece(poses, 1, 24, numbers(0, 200)), piece(poses, 25, 40, numbers(120, 300)).transformed(APART)
    found, shared = join([other, base], ONE_VIDEO)
    assert sorted(found) == list(range(1, 41))
    assert_at(found, poses, 1e-6)
    assert shared
    for (i, j), matches in shared.items():
        assert i < 24 <= j and len(matches) >= 4
        # Keypoint k of the first piece shows point k, of the second point 120 + k.
        assert (matches[:, 0] == matches[:, 1] + 120).all()


def test_wrong_likenesses_among_right_ones_do_not_move_a_piece() -> None:
    poses = walk()
    second = piece(poses, 25, 40, numbers(120, 300), 0.005)
    points = second.points.copy()
    points[:40] = points[np.random.default_rng(3).permutation(40)]
    wrong = PosePiece(second.numbers, second.poses, points, second.looks, second.seen)
    found, _ = join([piece(poses, 1, 24, numbers(0, 200), 0.005), wrong.transformed(APART)], ONE_VIDEO)
    assert sorted(found) == list(range(1, 41))
    assert_at(found, poses, 0.05)


def test_a_third_piece_joins_by_what_the_second_shows() -> None:
    poses = walk(60)
    parts = [
        piece(poses, 1, 24, numbers(0, 200)),
        piece(poses, 25, 42, numbers(120, 320)).transformed(APART),
        piece(poses, 43, 60, numbers(240, 440)).transformed(APART.inverse()),
    ]
    found, _ = join(parts, ONE_VIDEO)
    assert sorted(found) == list(range(1, 61))
    assert_at(found, poses, 1e-6)


def test_few_common_points_join_nothing() -> None:
    poses = walk()
    base, other = piece(poses, 1, 24, numbers(0, 200)), piece(poses, 25, 40, numbers(190, 390)).transformed(APART)
    found, shared = join([base, other], ONE_VIDEO)
    assert sorted(found) == list(range(1, 25)) and shared == {}
    assert all(found[n] is base.poses[n] for n in found)


def test_common_points_that_contradict_each_other_join_nothing() -> None:
    poses = walk()
    rng = np.random.default_rng(8)
    elsewhere = rng.uniform(-3, 3, (180, 3))
    other = piece(poses, 25, 40, numbers(120, 300), points=elsewhere)
    found, _ = join([piece(poses, 1, 24, numbers(0, 200)), other], ONE_VIDEO)
    assert sorted(found) == list(range(1, 25))


def test_a_similarity_that_makes_a_jump_in_time_is_refused() -> None:
    poses = walk()
    # The second piece shows a copy of the first one's room that is 20 meters away from the camera's path.
    far = {n: pose(p.rotation.matrix(), center_of(p) + [0, 20.0, 0]) for n, p in poses.items()}
    base, other = piece(poses, 1, 24, numbers(0, 200)), piece(far, 25, 40, numbers(120, 300)).transformed(APART)
    found, _ = join([base, other], ONE_VIDEO)
    assert sorted(found) == list(range(1, 25))


def test_a_second_video_may_begin_anywhere() -> None:
    poses = walk()
    far = {n: pose(p.rotation.matrix(), center_of(p) + [0, 20.0, 0]) for n, p in poses.items()}
    base, other = piece(poses, 1, 24, numbers(0, 200)), piece(far, 25, 40, numbers(120, 300)).transformed(APART)
    found, _ = join([base, other], (np.arange(40) >= 24).astype(np.int64))
    assert sorted(found) == list(range(1, 41))
    assert_at(found, poses | {n: far[n] for n in range(25, 41)}, 1e-6)


def test_common_points_on_a_line_leave_a_turn_open_and_join_nothing() -> None:
    poses = walk()
    line = np.array([1.0, 3, 0]) + np.linspace(0, 4, 80)[:, None] * [1, 0.2, 0.1]
    base = piece(poses, 1, 24, numbers(0, 80), points=line)
    other = piece(poses, 25, 40, numbers(0, 80), points=line).transformed(APART)
    assert sorted(join([base, other], ONE_VIDEO)[0]) == list(range(1, 25))


def test_many_points_may_be_near_each_other_and_few_may_not() -> None:
    poses = walk()
    rng = np.random.default_rng(5)
    counter = np.array([1.5, 3, 0]) + rng.uniform(-1, 1, (600, 3)) * [1.2, 0.32, 0.25]

    def joined(count: int) -> int:
        base = piece(poses, 1, 24, numbers(0, count), points=counter[:count])
        other = piece(poses, 25, 40, numbers(0, count), points=counter[:count]).transformed(APART)
        return len(join([base, other], ONE_VIDEO)[0])

    assert joined(600) == 40
    assert joined(100) == 24


def test_images_of_two_pieces_may_alternate() -> None:
    poses = walk()
    base, other = piece(poses, 1, 40, numbers(0, 200)), piece(poses, 1, 40, numbers(120, 300))

    def every_second(one: PosePiece, first: int) -> PosePiece:
        kept = one.numbers[first::2]
        return PosePiece(kept, {int(n): poses[int(n)] for n in kept}, one.points, one.looks, one.seen)

    found, _ = join([every_second(base, 0), every_second(other, 1).transformed(APART)], ONE_VIDEO)
    assert sorted(found) == list(range(1, 41))


def test_a_piece_has_the_points_that_its_features_show() -> None:
    poses = walk(12)
    rng = np.random.default_rng(2)
    points = rng.uniform((0, 2, -1), (3, 4, 1), (60, 3))
    shown_by, places = seen_from(poses, points)
    model = reconstruction(poses, points, shown_by, places)
    # Each point has a descriptor; the last five keypoints of an image are tracked points, which have none.
    table = rng.integers(0, 255, (60, 128)).astype(np.uint8)
    nothing = np.zeros(0, np.int64), np.zeros((0, 2))
    keypoints = [
        Keypoints(Features(places[n][:-5], table[shown_by[n][:-5]]), np.arange(5), places[n][-5:])
        if n % 2
        else Keypoints(Features(places[n], table[shown_by[n]]), *nothing)
        for n in sorted(poses)
    ]
    found = piece_of(model, range(1, 9), keypoints)
    assert found.numbers.tolist() == list(range(1, 9)) and sorted(found.poses) == list(range(1, 9))
    assert len(found.points) == len(found.looks) == len(found.seen) > 20
    for place, look, seen in zip(found.points, found.looks, found.seen, strict=True):
        which = int(np.argmin(np.linalg.norm(points - place, axis=1)))
        expected = np.sqrt(table[which] / table[which].sum(dtype=float))
        assert np.allclose(place, points[which]) and np.allclose(look, expected, atol=1e-4)
        assert all(shown_by[n][k] == which and n < 9 for n, k in seen)
    moved = found.transformed(APART)
    assert np.allclose(moved.points, [APART * p for p in found.points])
    assert np.allclose(moved.center(3), APART * found.center(3))
