"""Drift is undone where a walk closes loops; a wrong loop moves nothing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pycolmap
import pytest
from known_reconstruction import center_of, facing, pose, reconstruction, seen_from
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nvsim.poses.match_database import Pair
from nvsim.poses.pose_graph import FIRM, PartAnchors, empty_loops, keeps_shape, solve, without_drift
from nvsim.poses.two_views import TwoViews, from_matches

ROUND, COUNT, RADIUS = 72, 144, 4.0
"""Images of one round and of the walk of two rounds; meters."""
GROUP = 12


class Walk:
    """Two rounds around a courtyard, looking outward. A point is seen within a few images and again a round later, but
    then it is another point of the reconstruction. Everything slips slowly in scale, direction and place."""

    def __init__(self, drift: float) -> None:
        rng = np.random.default_rng(1)
        angle = 2 * np.pi * np.arange(COUNT) / ROUND
        out = np.stack([np.cos(angle), np.sin(angle), np.zeros(COUNT)], axis=1)
        true = {k + 1: pose(facing(out[k]), RADIUS * out[k]) for k in range(COUNT)}
        spread = rng.uniform(0, 2 * np.pi, 1500)
        distance = rng.uniform(RADIUS + 2, RADIUS + 4, 1500)
        points = np.column_stack([distance * np.cos(spread), distance * np.sin(spread), rng.uniform(-1, 1, 1500)])
        shown_by, _ = seen_from(true, points)
        self.true = np.array([center_of(true[n]) for n in sorted(true)])
        # A copy of the point for each round, and for each stretch of images, whose drift it has.
        copies: dict[tuple[int, int], int] = {}
        moved: list[NDArray[np.float64]] = []
        own: dict[int, list[int]] = {}
        for n, shown in shown_by.items():
            own[n] = []
            for point in shown:
                key = int(point), (n - 1) // GROUP
                if key not in copies:
                    copies[key] = len(moved)
                    moved.append(self.slipped(points[point], (n - 1) // GROUP * GROUP + GROUP / 2, drift))
                own[n].append(copies[key])
        poses = {n: self.slipped_pose(one, n - 1, drift) for n, one in true.items()}
        places = {n: np.zeros((len(o), 2)) for n, o in own.items()}
        self.model = reconstruction(poses, np.array(moved), own, places)
        self.shown_by = {n: shown.tolist() for n, shown in shown_by.items()}

    @staticmethod
    def slip(at: float, drift: float) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        """Scale, rotation and move at an image."""
        share = drift * at / COUNT
        turn = Rotation.from_rotvec([0.02 * share, -0.03 * share, 0.12 * share]).as_matrix()
        return float(np.exp(0.25 * share)), turn, np.array([0.4, -0.2, 0.3]) * share

    def slipped(self, point: NDArray[np.float64], at: float, drift: float) -> NDArray[np.float64]:
        scale, turn, move = self.slip(at, drift)
        return np.asarray(scale * turn @ point + move)

    def slipped_pose(self, one: pycolmap.Rigid3d, at: float, drift: float) -> pycolmap.Rigid3d:
        _, turn, _ = self.slip(at, drift)
        return pose(one.rotation.matrix() @ turn.T, self.slipped(center_of(one), at, drift))

    def loop(self, i: int, j: int, shift: int = 0) -> TwoViews:
        """The matches of images i and j (indices). With a `shift`, each point is taken for another one."""
        one, other = self.shown_by[i + 1], self.shown_by[j + 1]
        if shift:
            count = min(len(one), len(other))
            return from_matches(np.stack([np.arange(count), (np.arange(count) + shift) % count], 1).astype(np.uint32))
        _, mine, theirs = np.intersect1d(one, other, return_indices=True)
        return from_matches(np.stack([mine, theirs], axis=1).astype(np.uint32))

    def loops(self, every: int = 6) -> dict[Pair, TwoViews]:
        return {(k, k + ROUND): self.loop(k, k + ROUND) for k in range(0, ROUND, every)}

    def error(self, poses: Mapping[int, pycolmap.Rigid3d]) -> float:
        """Root mean square in meters, after the best similarity."""
        found = np.array([center_of(poses[n]) for n in sorted(poses)])
        return misplaced(found, self.true)


def misplaced(found: NDArray[np.float64], true: NDArray[np.float64]) -> float:
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1, 1, np.linalg.det(u @ vt)])
    scale = (s * sign).sum() / (a**2).sum()
    return float(np.sqrt(((scale * a @ (u @ np.diag(sign) @ vt).T - b) ** 2).sum(axis=1).mean()))


def poses_of(model: pycolmap.Reconstruction) -> dict[int, pycolmap.Rigid3d]:
    return {n: model.images[n].cam_from_world() for n in model.reg_image_ids()}


@pytest.fixture(scope="module")
def drifting() -> Walk:
    return Walk(1.0)


def test_true_loops_undo_the_drift(drifting: Walk) -> None:
    before = drifting.error(poses_of(drifting.model))
    poses, agreed = without_drift(drifting.model, drifting.loops())
    assert agreed == list(drifting.loops())
    assert sorted(poses) == list(range(1, COUNT + 1))
    assert drifting.error(poses) < before / 5


def test_a_wrong_loop_among_right_ones_is_refused_and_moves_nothing(drifting: Walk) -> None:
    right = drifting.loops()
    wrong = {(10, 100): drifting.loop(10, 100, shift=5)}
    poses, agreed = without_drift(drifting.model, right | wrong)
    alone, _ = without_drift(drifting.model, right)
    assert agreed == list(right)
    for n, one in alone.items():
        assert np.allclose(center_of(poses[n]), center_of(one), atol=1e-6)
        assert np.allclose(poses[n].rotation.matrix(), one.rotation.matrix(), atol=1e-6)


def test_a_wrong_loop_alone_is_refused_and_moves_nothing() -> None:
    walk = Walk(0.0)
    poses, agreed = without_drift(walk.model, {(10, 46): walk.loop(10, 46, shift=5)})
    assert agreed == []
    assert all(np.allclose(center_of(poses[n]), center_of(one)) for n, one in poses_of(walk.model).items())


def test_a_walk_without_drift_stays_where_it_is() -> None:
    walk = Walk(0.0)
    poses, agreed = without_drift(walk.model, walk.loops())
    assert len(agreed) == len(walk.loops())
    off = [np.linalg.norm(center_of(poses[n]) - center_of(one)) for n, one in poses_of(walk.model).items()]
    assert max(off) < 0.01


def test_a_loop_without_points_or_without_poses_is_refused(drifting: Walk) -> None:
    empty = from_matches(np.zeros((0, 2), np.uint32))
    _, agreed = without_drift(drifting.model, drifting.loops() | {(3, 90): empty, (3, 500): empty})
    assert agreed == list(drifting.loops())
    poses, agreed = without_drift(drifting.model, {(3, 90): empty})
    assert agreed == [] and len(poses) == COUNT
    assert without_drift(drifting.model, {})[1] == []


class Misplaced(Walk):
    """The second round is 5 meters from its place, because the video was interrupted before it."""

    @staticmethod
    def slip(at: float, drift: float) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        return 1.0, np.eye(3), np.array([4.0, 3.0, 0.0]) if at >= ROUND else np.zeros(3)


ROUNDS = [list(range(1, ROUND + 1)), list(range(ROUND + 1, COUNT + 1))]


def test_many_loops_around_a_courtyard_move_a_piece_to_its_place() -> None:
    walk = Misplaced(0.0)
    loops = walk.loops(every=2)
    assert walk.error(poses_of(walk.model)) > 2 and without_drift(walk.model, loops)[1] == []
    poses, agreed = without_drift(walk.model, loops, pieces=ROUNDS)
    assert agreed == list(loops)
    assert walk.error(poses) < 0.01


@pytest.mark.parametrize("kept", [slice(0, 12), slice(0, 72, 6)], ids=["one corner", "few"])
def test_a_piece_is_not_moved_by_loops_in_one_corner_or_by_few(kept: slice) -> None:
    walk = Misplaced(0.0)
    loops = {(k, k + ROUND): walk.loop(k, k + ROUND) for k in range(ROUND)[kept]}
    if kept.stop == 12:
        loops |= {(k, k + ROUND + 1): walk.loop(k, k + ROUND + 1) for k in range(12)}
    poses, agreed = without_drift(walk.model, loops, pieces=ROUNDS)
    assert agreed == []
    assert all(np.allclose(center_of(poses[n]), center_of(one)) for n, one in poses_of(walk.model).items())


def test_loops_may_move_a_video_but_not_bend_it() -> None:
    rng = np.random.default_rng(2)
    poses = Walk(0.0).model
    still = {n: poses.images[n].cam_from_world() for n in poses.reg_image_ids()}

    def moved(by: Mapping[int, NDArray[np.float64]]) -> pycolmap.Reconstruction:
        where = {n: pose(one.rotation.matrix(), center_of(one) + by[n]) for n, one in still.items()}
        points = rng.uniform(-6, 6, (50, 3))
        return reconstruction(where, points, {n: [0, 1] for n in still}, {n: np.zeros((2, 2)) for n in still})

    slow = moved({n: np.array([0.01, 0.005, 0.0]) * n for n in still})
    bent = moved({n: rng.normal(0, 1.0, 3) if n < 60 else np.zeros(3) for n in still})
    assert keeps_shape(poses, slow)
    assert not keeps_shape(poses, bent)


@pytest.mark.parametrize("drift", [3.0, 6.0, 12.0])  # degrees, to both sides
@pytest.mark.parametrize("oblique", [None, 20.0])  # degrees by which the wall of one part is off
def test_walls_correct_the_direction_of_a_video_that_turns_slowly(drift: float, oblique: float | None) -> None:
    parts = 14
    pivot = np.column_stack([3.0 * np.arange(parts), np.zeros(parts), np.ones(parts)])
    turned = np.radians(np.linspace(-drift, drift, parts))
    angle = turned + np.where(np.arange(parts) == 5, np.radians(oblique or 0.0), 0.0)
    wall = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(parts)])
    anchors = PartAnchors(np.ones(parts), np.tile([0.0, 0.0, 1.0], (parts, 1)), np.full(parts, 0.01), wall)
    slip = np.tile([FIRM[0], *[FIRM[1]] * 3, *[2 * FIRM[2]] * 3], (parts - 1, 1))
    moves = solve(empty_loops(), pivot, (pivot[1:] + pivot[:-1]) / 2, slip, anchors)
    left = np.degrees(moves[:, 3] + turned)
    assert np.ptp(left) < 0.2 + 0.2 * drift
