"""Regions grown from points: whole surfaces, never across an edge, and never what a negative point claims."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.perception.hybrid import normal_picture
from nvsim.perception.regions import RegionGrowing, grow_region

SHAPE = (90, 120)
FLOOR, DESK, LEG = np.zeros(SHAPE, bool), np.zeros(SHAPE, bool), np.zeros(SHAPE, bool)
FLOOR[55:] = True
DESK[20:30, 70:110] = True
LEG[30:70, 88:92] = True
FLOOR &= ~LEG
YES, NO = np.ones(1, bool), np.zeros(1, bool)


def scene() -> tuple[np.ndarray, np.ndarray]:
    """Normals of a wall with a floor and a desk before it, with a little noise; an image of one color with a rug."""
    rng = np.random.default_rng(1)
    normals = np.zeros((*SHAPE, 3))
    normals[...] = (0, -1, 0)
    normals[FLOOR | DESK] = (0, 0, 1)
    normals[LEG] = (1, 0, 0)
    normals += rng.normal(0, 0.03, normals.shape)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    image = np.full((*SHAPE, 3), 150, np.uint8)
    image[70:82, 20:60] = (90, 40, 30)
    return normals.astype(np.float32), image


def at(*points: tuple[float, float]) -> np.ndarray:
    return np.array(points, np.float64)


def test_one_point_gives_the_whole_floor_and_not_the_desk_that_lies_as_flat() -> None:
    normals, image = scene()
    assert np.array_equal(grow_region(normals, image, at((10, 80)), YES), FLOOR)
    assert np.array_equal(grow_region(normals, image, at((90.5, 25.5)), YES), DESK)


def test_points_on_two_surfaces_give_both() -> None:
    normals, image = scene()
    assert np.array_equal(grow_region(normals, image, at((10, 80), (80, 25)), np.ones(2, bool)), FLOOR | DESK)


def test_a_negative_point_on_another_surface_takes_that_surface_away() -> None:
    normals, image = scene()
    normals[30:56, 96:100] = (0, 0, 1)  # a leg whose normals are wrong joins desk and floor
    joined = grow_region(normals, image, at((10, 80)), YES)
    assert joined[DESK].all()
    image[DESK] = (200, 190, 160)
    found = grow_region(normals, image, at((10, 80), (90, 25)), np.array([True, False]))
    assert not (found & DESK).any() and (found & FLOOR).sum() > 0.99 * FLOOR.sum()


def test_a_negative_point_on_the_same_surface_cuts_along_the_edge_in_the_image() -> None:
    normals, image = scene()
    found = grow_region(normals, image, at((100, 85), (40, 76)), np.array([True, False]))
    rug = np.zeros(SHAPE, bool)
    rug[70:82, 20:60] = True
    wrong = found ^ (FLOOR & ~rug)
    assert wrong.sum() < 0.1 * rug.sum()
    assert not found[74:78, 25:55].any() and found[85, 100]


def test_without_a_normal_the_region_follows_the_color() -> None:
    normals, image = scene()
    normals[:] = 0
    found = grow_region(normals, image, at((40, 76)), YES)
    assert found[70:82, 20:60].all() and found.sum() == 12 * 40


def test_a_crease_is_felt_at_any_angle_above_the_limit() -> None:
    for tilt, same in ((10.0, True), (25.0, False)):
        normals = np.zeros((40, 60, 3), np.float32)
        normals[:, :30] = (0, 0, 1)
        normals[:, 30:] = (0, np.sin(np.radians(tilt)), np.cos(np.radians(tilt)))
        found = grow_region(normals, np.zeros((40, 60, 3), np.uint8), at((5, 5)), YES)
        assert found[:, :30].all() and bool(found[:, 30:].all()) == same


@pytest.mark.parametrize("place", [(-5.0, -5.0), (500.0, 500.0)])
def test_a_point_beside_the_image_counts_for_its_border(place: tuple[float, float]) -> None:
    normals, image = scene()
    found = grow_region(normals, image, at(place), YES)
    assert found[0, 0] if place[0] < 0 else found[-1, -1]


def test_only_negative_points_and_no_points_give_nothing() -> None:
    normals, image = scene()
    assert not grow_region(normals, image, at((10, 80)), NO).any()
    assert not grow_region(normals, image, np.empty((0, 2)), np.empty(0, bool)).any()


def test_it_fills_the_prompted_role_on_the_picture_of_the_normals() -> None:
    normals, _ = scene()
    camera = Camera(Intrinsics.from_fov(SHAPE[1], SHAPE[0], 1.4), camera_pose(np.zeros(3), 0.0))
    found = RegionGrowing().mask(normal_picture(normals), at((10, 80), (60, 85)), camera)
    assert np.array_equal(found, FLOOR)
