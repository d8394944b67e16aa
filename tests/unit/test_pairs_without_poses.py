"""Pairs of images, and the focal length of their camera, before any pose is known."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pycolmap
import pytest
from known_reconstruction import angle_between, turned
from numpy.typing import NDArray

from nvsim.poses.features import NOTHING, Features
from nvsim.poses.image_pairs import image_descriptors, neighbor_pairs, similar_pairs
from nvsim.poses.mapping import (
    center_of,
    consistent_pairs,
    contradicted_rotations,
    find_bends,
    rotation_angle,
    with_rotation,
)
from nvsim.poses.match_database import Pair
from nvsim.poses.pieces import split_after
from nvsim.poses.two_views import USUAL, TwoViews, estimate_focal_length, from_matches

WIDTH, HEIGHT = 1280, 720


def test_neighbors_are_of_one_video_and_near_in_time() -> None:
    clips = np.array([0] * 12 + [1] * 6)
    pairs = neighbor_pairs(clips)
    assert len(set(pairs)) == len(pairs)
    assert all(i < j and clips[i] == clips[j] for i, j in pairs)
    assert {(i, i + 1) for i in range(11)} | {(12 + i, 13 + i) for i in range(5)} <= set(pairs)
    assert {(i, i + 2) for i in range(10)} <= set(pairs)
    assert max(j - i for i, j in pairs) < 12 < len(pairs)
    assert neighbor_pairs(np.zeros(0, np.int64)) == [] and neighbor_pairs(np.zeros(1, np.int64)) == []


def images_of_places(count: int, places: int, seed: int = 0) -> list[Features]:
    """Image k shows place k modulo `places`: descriptors of that place, each a little changed, and some of its own."""
    rng = np.random.default_rng(seed)
    table = rng.gamma(0.6, 30, (places, 150, 128))
    found = []
    for k in range(count):
        own = table[k % places] * rng.uniform(0.8, 1.2, (150, 128))
        mixed = np.concatenate([own[rng.permutation(150)[:120]], rng.gamma(0.6, 30, (40, 128))])
        found.append(Features(rng.uniform(0, 300, (160, 2)), np.clip(mixed, 0, 255).astype(np.uint8)))
    return found


def test_similar_photographs_show_one_place() -> None:
    features = images_of_places(20, 2)
    pairs = similar_pairs(features, False, np.zeros(20, np.int64), most=3)  # 9 others show the place of each
    assert pairs == sorted(set(pairs)) and all(i < j for i, j in pairs)
    assert {(i, j) for i in range(20) for j in range(i + 2, 20, 2)} == set(pairs)


def test_similar_frames_of_a_video_are_far_apart_in_time_or_of_two_videos() -> None:
    features = images_of_places(80, 4)
    clips = (np.arange(80) >= 60).astype(np.int64)
    pairs = similar_pairs(features, True, clips, most=5)
    assert all(j - i >= 10 or clips[i] != clips[j] for i, j in pairs)
    assert np.mean([(j - i) % 4 == 0 for i, j in pairs]) > 0.95
    assert {i for pair in pairs for i in pair} == set(range(80))


def test_descriptors_of_one_place_are_nearer_than_those_of_two() -> None:
    words = image_descriptors(images_of_places(12, 3))
    assert np.allclose(np.linalg.norm(words, axis=1), 1, atol=1e-5)
    likeness = words @ words.T
    same = (np.arange(12)[:, None] - np.arange(12)) % 3 == 0
    others = ~np.eye(12, dtype=bool)
    assert likeness[same & others].min() > likeness[~same].max()
    assert np.array_equal(words, image_descriptors(images_of_places(12, 3)))


def test_images_without_features_have_pairs_all_the_same() -> None:
    assert similar_pairs([NOTHING] * 4, True, np.zeros(4, np.int64)) == []
    features = images_of_places(20, 2)
    features[3] = NOTHING
    assert similar_pairs(features, False, np.zeros(20, np.int64), most=2)


def matched_places(
    focal: float, count: int, seed: int = 0, noise: float = 0.4, turn_only: bool = False
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Matches of pairs of images of one camera that moves by decimeters and turns."""
    rng = np.random.default_rng(seed)
    middle = np.array([WIDTH, HEIGHT]) / 2
    for _ in range(count):
        rotation = turned(rng.uniform(4, 15), tuple(rng.normal(size=3) * (0.5, 1, 0.5)))
        move = np.zeros(3) if turn_only else rng.normal(size=3) * 0.35
        depth = rng.uniform(1.5, 7, 3000)
        points = np.column_stack([rng.uniform(-0.5, 0.5, (3000, 2)) * (WIDTH, HEIGHT) / focal * depth[:, None], depth])
        one, other = points, points @ rotation.T + move
        pixels = [focal * p[:, :2] / np.maximum(p[:, 2:], 0.1) + middle for p in (one, other)]
        shown = (other[:, 2] > 0.3) & (np.abs(pixels[1] - middle) < middle).all(axis=1)
        rows = np.flatnonzero(shown)[:250]
        a, b = (p[rows] + rng.normal(0, noise, (len(rows), 2)) for p in pixels)
        b[: len(rows) // 5] = rng.uniform((0, 0), (WIDTH, HEIGHT), (len(rows) // 5, 2))
        yield a, b


@pytest.mark.parametrize("share", [0.5, 0.7, 1.1])
def test_focal_length_is_found_from_pairs_that_move(share: float) -> None:
    cv2.setRNGSeed(0)
    found = estimate_focal_length(matched_places(share * WIDTH, 60), WIDTH, HEIGHT, None)
    assert found == pytest.approx(share * WIDTH, rel=0.03)


def test_focal_length_of_the_file_decides_only_what_images_leave_open() -> None:
    cv2.setRNGSeed(0)
    turning = list(matched_places(0.6 * WIDTH, 10, turn_only=True))
    assert estimate_focal_length(turning, WIDTH, HEIGHT, None) == pytest.approx(USUAL * WIDTH)
    assert estimate_focal_length(turning, WIDTH, HEIGHT, 900.0) == 900.0
    assert estimate_focal_length([], WIDTH, HEIGHT, None) == pytest.approx(USUAL * WIDTH)
    assert estimate_focal_length([], HEIGHT, WIDTH, None) == pytest.approx(USUAL * WIDTH)
    moving = list(matched_places(0.6 * WIDTH, 60))
    assert estimate_focal_length(moving, WIDTH, HEIGHT, 0.63 * WIDTH) == pytest.approx(0.6 * WIDTH, rel=0.03)


def turning_video(count: int = 12) -> dict[Pair, TwoViews]:
    """Relative rotations of frames that turn by 3 degrees from one to the next."""

    def views(i: int, j: int) -> TwoViews:
        plain = from_matches(np.zeros((60, 2), np.uint32))
        return TwoViews(turned(3.0 * (j - i), (0, 1, 0)), plain.matches, False, plain.geometry)

    return {(i, i + k): views(i, i + k) for i in range(count) for k in (1, 2, 5) if i + k < count}


def wrong(views: TwoViews, degrees: float, matches: int = 60) -> TwoViews:
    rotation = turned(degrees, (0, 1, 0)) @ views.rotation
    return TwoViews(rotation, np.zeros((matches, 2), np.uint32), False, views.geometry)


def test_pairs_that_agree_are_all_kept() -> None:
    found = turning_video()
    assert consistent_pairs(found) == found


def test_the_pair_that_contradicts_the_frames_between_is_dropped() -> None:
    found = turning_video()
    found[3, 8] = wrong(found[3, 8], 8)
    assert set(found) - set(consistent_pairs(found)) == {(3, 8)}


def test_a_missing_step_is_bridged_by_the_pair_around_it() -> None:
    for missing in ((4, 5), (0, 1), (10, 11)):
        found = turning_video()
        del found[missing]
        assert set(consistent_pairs(found)) == set(found)
        found[3, 8] = wrong(found[3, 8], 8)
        assert set(found) - set(consistent_pairs(found)) == {(3, 8)}


def test_a_pair_that_nothing_can_check_needs_many_matches() -> None:
    found = {(3, 8): wrong(turning_video()[3, 8], 0, matches=200), (4, 9): wrong(turning_video()[4, 9], 0, matches=20)}
    assert set(consistent_pairs(found)) == {(3, 8)}


@pytest.mark.parametrize("lost", [(), (6,), (5, 6, 7, 9)])
def test_rotations_that_contradict_the_pairs_around_them_are_corrected(lost: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    found = turning_video()
    rotations = [np.eye(3)]
    while (len(rotations) - 1, len(rotations)) in found:
        rotations.append(found[len(rotations) - 1, len(rotations)].rotation @ rotations[-1])
    true = {n + 1: pycolmap.Rigid3d(pycolmap.Rotation3d(r), np.array([n, 0, 0.0])) for n, r in enumerate(rotations)}
    poses = dict(true)
    for n in lost:
        poses[n] = with_rotation(true[n], turned(rng.uniform(15, 170), rng.normal(size=3)) @ rotations[n - 1])
        assert center_of(poses[n]) == pytest.approx(center_of(true[n]))
    found[1, 2] = wrong(found[1, 2], 20)  # one wrong pair does not matter
    contradicted = contradicted_rotations(poses, found)
    assert set(contradicted) == set(lost)
    for n in lost:
        assert angle_between(contradicted[n], rotations[n - 1]) < 0.1


@pytest.mark.parametrize("far", [0.3, 0.9])
def test_a_video_is_split_where_images_apart_disagree(far: float) -> None:
    found = turning_video()

    def agreement(pair: Pair) -> float:
        if pair == (8, 9):  # one wrong pair is no bend
            return 0.0
        crosses = pair[0] < 5 <= pair[1]
        return (far if pair[1] - pair[0] > 3 and crosses else 1.0) - 0.1 * crosses

    cuts = find_bends(range(1, 13), found, agreement)
    assert cuts == ([5] if far < 0.5 else [])
    assert split_after([[1, 2, 3, 4, 5, 6]], [4]) == [[1, 2, 3, 4], [5, 6]]
    assert split_after([[1, 2, 7, 8, 9], [3, 4]], [5, 6]) == [[7, 8, 9], [1, 2], [3, 4]]


def test_neighbors_decide_where_no_images_apart_match() -> None:
    found = {pair: views for pair, views in turning_video().items() if pair[1] - pair[0] < 5}
    crossing = {pair for pair in found if pair[0] < 5 <= pair[1]}
    assert find_bends(range(1, 13), found, lambda pair: 0.2 if pair in crossing else 1.0) == [5]
    assert find_bends(range(1, 13), {}, lambda pair: 0.0) == []


def test_the_angle_of_a_rotation_is_in_degrees() -> None:
    for degrees in (0.0, 0.5, 90.0, 179.0):
        assert rotation_angle(turned(degrees, (1, 2, -1))) == pytest.approx(degrees, abs=1e-5)
        assert angle_between(np.eye(3), turned(degrees, (1, 2, -1))) == pytest.approx(degrees, abs=1e-5)


def test_degenerate_matches_are_no_error() -> None:
    line = np.column_stack([np.linspace(10, 300, 80), np.full(80, 100.0)])
    place = np.tile(line[:1], (80, 1))
    pairs = [(line, line + (k + 1, 0.0)) for k in range(8)] + [(place, place)] * 8
    assert 0.3 * 320 < estimate_focal_length(pairs, 320, 240, 250.0) < 2 * 320
