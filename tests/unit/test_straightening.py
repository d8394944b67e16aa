"""A video whose parts slipped in scale, place and direction is straight again by its floor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from known_reconstruction import HEIGHT, WIDTH, center_of, facing, places_in, pose, reconstruction, seen_from, turned
from numpy.typing import NDArray

from nvsim.geometry.rotation import rotation_angle
from nvsim.poses import straightening
from nvsim.poses.pieces import names_in, split_off, with_images_beside, with_single_images
from nvsim.poses.straightening import (
    contradicts_floor,
    level_and_scale,
    merge_turning_pieces,
    rotated_images,
    straighten_video,
)
from nvsim.poses.two_views import TwoViews, from_matches

HIGH, STEP = 1.5, 0.4  # meters
LEG, TURN = 26, 15  # images of a straight leg, and of a turn on the spot by a quarter
TIMES = np.cumsum(np.tile(np.repeat([0.45, 0.15], [LEG, TURN]), 5))  # seconds: a turn takes a few
EDGE = 4  # images at the ends of a leg in which a person starts and stops


def true_walk(legs: int = 2, ease: float = 1.0, edge: float = 0.5) -> dict[int, pycolmap.Rigid3d]:
    """Straight legs with turns on the spot between them; the camera sways and looks a little down. The turns begin
    slowly if `ease` is above 1. The camera starts and stops within `edge` images."""
    poses: dict[int, pycolmap.Rigid3d] = {}
    place, yaw = np.array([0.0, 0.0]), 0.0
    for leg in range(legs):
        for k in range(LEG):
            speed = min(1.0, (k + 0.5) / edge, (LEG - k - 0.5) / edge)
            place = place + speed * STEP * np.array([np.cos(yaw), np.sin(yaw)])
            sway = yaw + 0.03 * np.sin(0.9 * k)
            ahead = np.array([np.cos(sway), np.sin(sway), -0.35])
            height = HIGH * (1 + 0.01 * np.sin(2.1 * k))
            poses[len(poses) + 1] = pose(facing(ahead), np.array([*place, height]))
        for k in range(TURN if leg + 1 < legs else 0):
            now = yaw + np.pi / 2 * ((k + 1) / (TURN + 1)) ** ease
            poses[len(poses) + 1] = pose(facing(np.array([np.cos(now), np.sin(now), -0.35])), np.array([*place, HIGH]))
        yaw += np.pi / 2
    return poses


def stages(legs: int) -> list[tuple[int, int]]:
    """First and last number of the images of each leg and turn."""
    found, first = [], 1
    for leg in range(legs):
        found.append((first, first + LEG - 1))
        first += LEG
        if leg + 1 < legs:
            found.append((first, first + TURN - 1))
            first += TURN
    return found


def slipped(
    true: dict[int, pycolmap.Rigid3d], scales: list[float], slip: NDArray[np.float64]
) -> pycolmap.Reconstruction:
    """Each leg and turn as large as `scales` says, about its first camera, in a world that is turned by `slip`. Legs
    share few points with what follows."""
    rng = np.random.default_rng(4)
    poses: dict[int, pycolmap.Rigid3d] = {}
    points: list[NDArray[np.float64]] = []
    shown: dict[int, list[int]] = {n: [] for n in true}
    places: dict[int, list[NDArray[np.float64]]] = {n: [] for n in true}
    end = np.zeros(3)
    for (first, last), scale in zip(stages(len(scales) // 2 + 1), scales, strict=True):
        own = {n: true[n] for n in range(first, last + 1)}
        start = center_of(true[first])
        cloud = np.concatenate([center_of(p) + rng.uniform(-5, 5, (90, 3)) for p in own.values()])
        floor = rng.random(len(cloud)) < 0.5
        cloud[:, 2] = np.where(floor, 0.0, rng.uniform(0.1, 2.6, len(cloud)))
        if last - first + 1 == TURN:
            cloud = cloud[:80]
        seen, at = seen_from(own, cloud, 7.0)
        step = center_of(true[first]) - center_of(true[max(1, first - 1)])
        origin = end + scale * slip @ step
        for n, one in own.items():
            center = origin + scale * slip @ (center_of(one) - start)
            poses[n] = pose(one.rotation.matrix() @ slip.T, center)
            shown[n] += [len(points) + int(k) for k in seen[n]]
            places[n] += list(at[n])
            end = center
        points += [origin + scale * slip @ (p - start) for p in cloud]
    return reconstruction(poses, np.array(points), shown, {n: np.array(p).reshape(-1, 2) for n, p in places.items()})


def distances(found: dict[int, pycolmap.Rigid3d], true: dict[int, pycolmap.Rigid3d]) -> NDArray[np.float64]:
    """Meters by image, after the best rotation about the vertical, and translation; no change of scale."""
    a = HIGH * np.array([center_of(found[n]) for n in sorted(found)])
    b = np.array([center_of(true[n]) for n in sorted(found)])
    p, q = a[:, :2] - a[:, :2].mean(axis=0), b[:, :2] - b[:, :2].mean(axis=0)
    yaw = np.angle(((p[:, 0] - 1j * p[:, 1]) * (q[:, 0] + 1j * q[:, 1])).sum())
    turn = turned(float(np.degrees(yaw)), (0, 0, 1))
    moved = (a - a.mean(axis=0)) @ turn.T + b.mean(axis=0)
    return np.asarray(np.linalg.norm(moved - b, axis=1))


@pytest.mark.parametrize("scales", [[1.0, 1.0, 1.0], [0.3, 0.9, 2.2], [4.0, 0.2, 0.5]])
def test_legs_of_any_scale_are_one_walk_again(tmp_path: Path, scales: list[float]) -> None:
    true = true_walk(edge=EDGE)
    model = slipped(true, scales, turned(60, (1, 2, 3)))
    found = straighten_video([model], tmp_path, TIMES, {})
    assert set(found) == set(true)
    assert distances(found, true).max() < 1.5 * STEP  # the camera stops faster than assumed
    for n, one in found.items():  # z is up, and its rotations are those of the walk but for one about the vertical
        assert one.rotation.matrix()[:, 2] == pytest.approx(true[n].rotation.matrix()[:, 2], abs=0.02)


@pytest.mark.parametrize("aside", [0.0, 30.0, 90.0])  # degrees between the viewing direction and that of the walk
def test_a_camera_that_is_not_placed_goes_on_in_time_with_the_direction_relative_to_its_view(aside: float) -> None:
    """The closed form: a circle. Half of its images have no place, and frames are not evenly spaced in time."""
    rate, radius = np.radians(30), 1.5  # of the circle: radians per second, meters
    seconds = np.cumsum(np.where(np.arange(40) % 3 == 0, 0.3, 0.1))

    def on_circle(t: float) -> pycolmap.Rigid3d:
        view = rate * t + np.radians(aside)
        place = radius * np.array([np.sin(rate * t), -np.cos(rate * t), 0])
        return pose(facing(np.array([np.cos(view), np.sin(view), -0.2])), place)

    true = {k + 1: on_circle(t) for k, t in enumerate(seconds)}
    before, after = ({n: true[n] for n in numbers} for numbers in (range(1, 11), range(31, 41)))
    between = {n: pycolmap.Rigid3d(true[n].rotation, np.zeros(3)) for n in range(11, 31)}
    timeline = straightening._Timeline(seconds, np.zeros(39, bool))
    for known, following in ((before, after), (before, {}), ({}, after)):
        found = straightening._dead_reckoned_centers(known, following, between, timeline)
        off = [np.linalg.norm(center - center_of(true[n])) for n, center in found.items()]
        assert max(off) < 0.03  # of a path of 2.6 meters


def test_a_camera_that_only_rotates_stays() -> None:
    """A walk of 1 m/s, a slow turn in place of six images that show so, by pairs that skip an image, and a walk."""
    place = np.cumsum([0.2] * 9 + [0] * 6 + [0.2] * 9)
    yaw = np.cumsum([0] * 9 + [0.05] * 6 + [0] * 9)
    views = [facing(np.array([np.cos(y), np.sin(y), -0.2])) for y in yaw]
    true = {n: pose(views[n - 1], np.array([place[n - 1], 0, HIGH])) for n in range(1, 25)}
    before, after = ({n: true[n] for n in numbers} for numbers in (range(1, 10), range(15, 25)))
    between = {n: pycolmap.Rigid3d(true[n].rotation, np.zeros(3)) for n in range(10, 15)}
    off = []
    for rotates in (False, True):
        pairs = {
            (n - 1, n + 1): replace(from_matches(np.zeros((0, 2), np.uint32)), turned=rotates) for n in range(9, 15)
        }
        timeline = straightening._Timeline(0.2 * np.arange(24), straightening._only_rotating(pairs, 24))
        found = straightening._dead_reckoned_centers(before, after, between, timeline)
        off.append(max(float(np.linalg.norm(center - center_of(true[n]))) for n, center in found.items()))
    assert off[0] > 0.5
    assert off[1] < 1e-9


def test_the_pair_that_spans_the_fewest_images_decides_whether_the_camera_only_rotates() -> None:
    turned, moved = (replace(from_matches(np.zeros((0, 2), np.uint32)), turned=t) for t in (True, False))
    pairs = {(0, 4): turned, (1, 2): moved, (5, 6): turned, (2, 9): turned}
    assert straightening._only_rotating(pairs, 10).tolist() == [1, 0, 1, 1, 0, 1, 0, 0, 0]


def test_two_reconstructions_that_follow_each_other_are_one_walk(tmp_path: Path) -> None:
    true = true_walk(edge=EDGE)
    model = slipped(true, [1.0, 1.0, 1.0], np.eye(3))
    half = LEG + TURN // 2
    first, second = pycolmap.Reconstruction(model), pycolmap.Reconstruction(model)
    for n in true:
        (first if n > half else second).deregister_frame(n)
    turn = turned(130, (1, 0, 1))
    second.transform(pycolmap.Sim3d(0.4, pycolmap.Rotation3d(turn), np.array([3.0, -2, 1])))
    assert names_in(first) and names_in(second)
    found = straighten_video([second, first], tmp_path, TIMES, {})
    assert set(found) == set(true)
    assert distances(found, true).max() < 1.5 * STEP  # the camera stops faster than assumed


def test_without_a_floor_nothing_is_straightened(tmp_path: Path) -> None:
    true = true_walk(1)
    rng = np.random.default_rng(0)
    points = np.concatenate([center_of(p) + rng.uniform(-5, 5, (60, 3)) for p in true.values()])
    points[:, 2] = rng.uniform(0.9, 2.6, len(points))
    shown, places = seen_from(true, points, 7.0)
    assert straighten_video([reconstruction(true, points, shown, places)], tmp_path, TIMES, {}) == {}


def test_pieces_are_one_only_if_the_building_is_the_same_on_both_sides(tmp_path: Path) -> None:
    true = true_walk()
    model = slipped(true, [1.0, 1.0, 1.0], np.eye(3))
    before, after = list(range(1, LEG + 1)), list(range(LEG + TURN + 1, 2 * LEG + TURN + 1))
    # Nothing is known of walls without images, so nothing is joined.
    assert merge_turning_pieces(model, [before, after], tmp_path, {}) == [before, after]


def common_cloud(legs: int, ease: float = 1.0) -> pycolmap.Reconstruction:
    """The true walk, with points that all of its images may see."""
    true = true_walk(legs, ease)
    rng = np.random.default_rng(1)
    points = np.concatenate([center_of(p) + rng.uniform(-5, 5, (60, 3)) for p in true.values()])
    shown, places = seen_from(true, points, 7.0)
    return reconstruction(true, points, shown, places)


@pytest.mark.parametrize("same", [True, False])
def test_a_camera_that_comes_back_may_have_two_pieces_that_alternate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, same: bool
) -> None:
    """Loops join the first leg to the third, so that the second leg lies between the images of one piece."""
    compared: list[tuple[int, int]] = []

    def is_held(model: object, before: list[int], after: list[int], folder: Path) -> bool:
        compared.append((before[-1], after[0]))
        return same

    monkeypatch.setattr(straightening, "_is_held", is_held)
    model = common_cloud(3)
    legs = [list(range(first, last + 1)) for first, last in stages(3)[::2]]
    turns = [[n] for first, last in stages(3)[1::2] for n in range(first, last + 1)]
    found = merge_turning_pieces(model, [legs[0] + legs[2], legs[1], *turns], tmp_path, {})
    assert compared[0] == (legs[0][-1], legs[1][0])
    if same:
        assert found == [list(range(1, 3 * LEG + 2 * TURN + 1))]
    else:
        assert compared[1:] == [(legs[1][-1], legs[2][0])]
        assert all(not {legs[0][3], legs[1][3]} <= set(piece) for piece in found)


def pairs_of(true: dict[int, pycolmap.Rigid3d]) -> dict[tuple[int, int], TwoViews]:
    """The relative poses of each image and the next three, by index. They have an error of 0.2 degrees."""
    rng = np.random.default_rng(2)
    found = {}
    for i, one in true.items():
        for j in range(i + 1, min(i + 4, max(true) + 1)):
            relative = true[j].rotation.matrix() @ one.rotation.matrix().T @ turned(0.2, rng.normal(size=3))
            still = bool(np.linalg.norm(center_of(one) - center_of(true[j])) < STEP / 4)
            pair = from_matches(np.zeros((100, 2), np.uint32))
            found[i - 1, j - 1] = replace(pair, rotation=relative, turned=still)
    return found


@pytest.mark.parametrize("ease", [1.0, 1.4])  # 1.4: the camera turns by 2 degrees first, later by 8
@pytest.mark.parametrize("away", [0.0, 2.0])  # meters by which the images of the turn are displaced
def test_a_turn_at_the_end_of_a_piece_is_kept_and_a_walk_is_not(tmp_path: Path, ease: float, away: float) -> None:
    true = true_walk(2, ease)
    model = common_cloud(2, ease)
    (_, last), (turn, turned_last), (walk, end) = stages(2)
    for n in range(turn, turned_last + 1) if away else ():
        place = center_of(true[n]) + away
        model.frames[model.images[n].frame_id].rig_from_world = pose(true[n].rotation.matrix(), place)
    piece, loose = list(range(1, last + 1)), [[n] for n in range(last + 1, end + 1)]
    found = merge_turning_pieces(model, [piece, *loose], tmp_path, pairs_of(true))
    assert found[0][:turned_last] == list(range(1, turned_last + 1))
    assert max(found[0]) <= walk  # beyond, the walk has an unknown scale
    for n in found[0]:
        one = model.images[n].cam_from_world()
        assert np.linalg.norm(center_of(one) - center_of(true[n])) < STEP
        assert rotation_angle(one.rotation.matrix() @ true[n].rotation.matrix().T) < 1.5 or not away
    half = merge_turning_pieces(model, [piece[: LEG // 2], *[[n] for n in piece[LEG // 2 :]]], tmp_path, pairs_of(true))
    assert half[0] == piece[: LEG // 2 + 1]  # one more step, from which the points of the piece are seen


def test_an_image_beside_a_piece_is_kept_if_it_sees_points_of_the_piece(tmp_path: Path) -> None:
    true = true_walk(2)
    model = slipped(true, [1.0, 1.0, 1.0], np.eye(3))  # each leg has its own points
    (_, last), _, (walk, end) = stages(2)
    piece, loose = list(range(1, last + 1)), [[n] for n in range(last + 1, end + 1)]
    assert merge_turning_pieces(model, [piece, *loose], tmp_path, {})[0] == piece
    half = last - 10
    found = merge_turning_pieces(
        model, [piece[:half], *[[n] for n in (*piece[half:], *range(last + 1, end + 1))]], tmp_path, {}
    )
    assert found[0] == piece[: half + 1]
    assert walk not in found[0]


def test_a_piece_grows_by_near_images_that_see_its_points() -> None:
    model = slipped(true_walk(2), [1.0, 1.0, 1.0], np.eye(3))  # each leg has its own points
    (_, last), _, (walk, end) = stages(2)
    piece, half = list(range(1, last + 1)), last - 10
    pieces = [piece[:half], list(range(walk, end + 1)), *[[n] for n in range(half + 1, walk)]]
    assert with_images_beside(model, pieces, reach=1.5 * STEP)[:2] == [pieces[1], piece[: half + 1]]
    assert with_images_beside(model, pieces, reach=0.5 * STEP) == sorted(pieces, key=len, reverse=True)
    assert with_images_beside(model, [piece, pieces[1]], reach=STEP) == [piece, pieces[1]]


def test_a_single_image_belongs_to_the_piece_around_it() -> None:
    pieces = [[1, 2, 3, 5, 6, 8], [10, 11, 12], [4], [7], [9], [13]]
    assert with_single_images(pieces) == [[1, 2, 3, 4, 5, 6, 7, 8], [10, 11, 12], [9], [13]]


def test_images_that_are_split_off_become_pieces() -> None:
    assert split_off([[1, 2, 3, 4, 5], [6, 7, 8]], {4, 5, 8, 9}) == [[1, 2, 3], [4, 5], [6, 7], [8]]


def test_a_stretch_of_another_scale_contradicts_the_floor(tmp_path: Path) -> None:
    true = true_walk()
    assert not contradicts_floor(slipped(true, [1.0, 1.0, 1.0], turned(20, (1, 2, 3))), tmp_path)
    assert contradicts_floor(slipped(true, [1.0, 1.0, 1.15], turned(20, (1, 2, 3))), tmp_path)


def test_a_reconstruction_is_leveled_to_camera_heights() -> None:
    true = true_walk()
    model = slipped(true, [2.7] * 3, turned(50, (3, 1, 2)))
    assert level_and_scale(model, Path("no images"))
    for n, one in true.items():
        assert model.images[n].projection_center()[2] - model.images[1].projection_center()[2] == pytest.approx(
            (center_of(one)[2] - center_of(true[1])[2]) / HIGH, abs=0.01
        )
    steps = [
        np.linalg.norm(model.images[n + 1].projection_center() - model.images[n].projection_center()) for n in (3, 9)
    ]
    assert steps == pytest.approx([STEP / HIGH] * 2, rel=0.02)
    bare = slipped(true, [2.7] * 3, np.eye(3))
    for number in list(bare.points3D):
        bare.delete_point3D(number)
    assert not level_and_scale(bare, Path("no images"))


def test_vertical_edges_determine_up_in_place_of_the_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    """The edges say that the vertical is 2 degrees from that of the floor; the height follows from them too."""
    edges = turned(2, (0, 1, 0)) @ (0, 0, 1.0)
    monkeypatch.setattr(straightening, "vertical_from_lines", lambda lines, up: (edges, 0.001))
    model = slipped(true_walk(), [1.0] * 3, np.eye(3))
    upright = model.images[1].cam_from_world().rotation.matrix()
    assert level_and_scale(model, Path("no images"))
    rotated = model.images[1].cam_from_world().rotation.matrix().T @ upright
    assert rotated @ edges == pytest.approx([0, 0, 1], abs=1e-6)


def draw_shelves(folder: Path, true: dict[int, pycolmap.Rigid3d]) -> None:
    """The images of a hall with shelves along both directions of its walls."""
    spots = np.arange(-6.0, 26.0, 2.0)
    ends = [((-8, y, z), (28, y, z)) for y in spots for z in (0.4, 2.0)]
    ends += [((x, -8, z), (x, 28, z)) for x in spots for z in (0.4, 2.0)]
    segments = np.array(ends)[:, 0, None] + np.linspace(0, 1, 400)[:, None] * np.diff(np.array(ends), axis=1)
    for n, one in true.items():
        image = np.full((HEIGHT, WIDTH), 200, np.uint8)
        for segment in segments:
            places, shown = places_in(one, segment)
            near = shown & (np.linalg.norm(segment - center_of(one), axis=1) < 6)
            if near.sum() > 1:
                cv2.polylines(image, [np.round(places[near]).astype(np.int32)], False, 0, 3)
        assert cv2.imwrite(str(folder / f"{n:06d}.jpg"), image)


def test_images_are_rotated_if_their_walls_are(tmp_path: Path) -> None:
    true = true_walk(3)
    draw_shelves(tmp_path, true)
    last, first, count = stages(3)[2][1], stages(3)[4][0], len(true)
    turn = {(n - 1, n): from_matches(np.zeros((0, 2), np.uint32)) for n in range(last, first)}
    for degrees, found in ((0.0, ()), (1.0, ()), (6.0, range(last + 1, count + 1)), (30.0, ())):  # 30: another wing
        own = turned(degrees, (0, 0, 1))
        after = range(first, count + 1)
        moved = true | {n: pose(true[n].rotation.matrix() @ own.T, center_of(true[n])) for n in after}
        model = slipped(moved, [1.0] * 5, np.eye(3))
        assert rotated_images(model, tmp_path, turn, count) == set(found)
        assert rotated_images(model, tmp_path, {}, count) == set()  # a wing that the camera walks into
    everything_turns = {(n - 1, n): from_matches(np.zeros((0, 2), np.uint32)) for n in range(1, count)}
    assert rotated_images(model, tmp_path, everything_turns, count) == set()
