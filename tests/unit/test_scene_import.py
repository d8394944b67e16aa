"""Scenes from splats alone: up, scale, storeys, stairs, and floaters of synthetic rooms; scenes that are refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from splat_rooms import any_rotation, box, joined, moved, rectangle, stair_house, table, two_rooms, without

from nvsim.errors import InputError
from nvsim.scene_import.cleaning import far_from_floor, floaters
from nvsim.scene_import.levels import find_storeys
from nvsim.scene_import.parts import find_stairs
from nvsim.scene_import.scene import align_scene, points_of
from nvsim.scene_import.slab_cover import Grid, slab_cover
from nvsim.splats.types import Gaussians


@cache
def aligned(seed: int, scale: float, given: float | None):
    rotation = any_rotation(seed)
    scene = align_scene("room.ply", moved(two_rooms(), rotation, scale), "-y", scale=given)
    return rotation, scene


@pytest.mark.parametrize(("seed", "scale"), [(0, 1.0), (1, 3.3), (2, 0.2)])
def test_up_is_found_in_any_rotation_and_scale(seed, scale):
    rotation, scene = aligned(seed, scale, 1 / scale)
    up = scene.rotation.T @ [0.0, 0.0, 1.0]
    assert np.degrees(np.arccos(min(1.0, up @ rotation[:, 2]))) < 0.3
    (level,) = scene.storeys.levels
    assert abs(level.height) < 0.02 and abs(level.ceiling - 2.7) < 0.04
    assert level.known.sum() * 0.05**2 == pytest.approx(8.1 * 5, rel=0.05)
    assert scene.scale_known and not scene.doubts


def test_the_walls_of_two_storeys_are_not_taken_for_floors():
    rotation = any_rotation(5)
    scene = align_scene("house.ply", moved(stair_house(), rotation, 1.0), "-y", scale=1.0)
    assert np.degrees(np.arccos(min(1.0, (scene.rotation.T @ [0, 0, 1]) @ rotation[:, 2]))) < 0.3
    assert len(scene.storeys.levels) == 2


def test_a_scene_that_is_upside_down_for_its_format_is_turned_by_its_furniture():
    scene = align_scene("room.ply", two_rooms(), "-z")
    assert scene.rotation @ [0, 0, 1] == pytest.approx([0, 0, 1], abs=1e-6)


def test_a_bright_ceiling_shows_which_side_of_empty_rooms_is_up():
    room = without(two_rooms(), (0.5, 0.1, 0.02), (7.95, 4.9, 1.0))  # without furniture
    room.sh[room.means[:, 2] > 2.6] = 1.2
    for seed in range(3):
        rotation = any_rotation(seed)
        scene = align_scene("room.ply", moved(room, rotation, 1.0), "-y", scale=1.0)
        assert (scene.rotation.T @ [0.0, 0.0, 1.0]) @ rotation[:, 2] > 0.999
        assert not scene.doubts


def test_lintels_of_many_doors_do_not_turn_a_room_upside_down():
    lintels = [rectangle((x, 1.0, 2.0), (0, 3.0, 0), (0, 0, 0.69), 0.03) for x in np.arange(0.3, 3.8, 0.2)]
    for seed in range(3):
        rotation = any_rotation(seed)
        house = moved(joined(two_rooms(), *lintels), rotation, 1.0)
        scene = align_scene("room.ply", house, "-y", scale=1.0)
        assert (scene.rotation.T @ [0.0, 0.0, 1.0]) @ rotation[:, 2] > 0.999


def test_the_user_can_name_the_up_axis():
    scene = align_scene("room.ply", two_rooms(), "-y", up="-z")
    assert scene.rotation @ [0, 0, -1] == pytest.approx([0, 0, 1], abs=1e-6)


def test_rooms_of_usual_height_are_metric_and_others_get_a_suggestion():
    _, scene = aligned(0, 1.0, None)
    assert scene.scale == 1.0 and scene.scale_known
    _, scene = aligned(1, 3.3, None)
    assert scene.scale == pytest.approx(2.6 / (2.7 * 3.3), rel=0.02) and not scene.scale_known
    assert "--scale" in scene.doubts[0]


def test_an_assumed_unit_is_said_if_no_ceiling_shows_the_scale():
    room = without(two_rooms(), (2.0, -0.1, 2.6), (8.2, 5.1, 2.8))  # a quarter of the ceiling remains
    scene = align_scene("room.ply", room, "-y", up="z")
    assert scene.scale == 1.0 and not scene.scale_known
    assert any("--scale" in doubt and "meter" in doubt for doubt in scene.doubts)


def test_places_are_on_free_floor_inside():
    terrace = rectangle((8.2, 0, 0), (6, 0, 0), (0, 5, 0))
    scene = align_scene("room.ply", joined(two_rooms(), terrace), "-y", up="z")
    (level,) = scene.storeys.levels
    x, y = level.places[:, :2].T
    assert x.min() > 0.2 and x.max() < 7.9 and y.min() > 0.2 and y.max() < 4.8
    assert not ((x > 0.9) & (x < 2.3) & (y > 2.9) & (y < 3.9)).any()  # the table
    assert not ((x > 6.4) & (y < 2.3)).any()  # the bed
    assert (x < 4).any() and (x > 4.1).any()


def test_floor_under_a_ceiling_that_is_hardly_shown_is_known_if_walls_enclose_it():
    room = without(two_rooms(), (1.5, -0.1, 2.6), (8.2, 5.1, 2.8))  # a fifth of the ceiling remains
    scene = align_scene("room.ply", joined(room, rectangle((8.2, 0, 0), (6, 0, 0), (0, 5, 0))), "-y", up="z", scale=1.0)
    (level,) = scene.storeys.levels
    assert level.area == pytest.approx(8.1 * 5, rel=0.1)
    assert level.places[:, 0].max() < 7.9 and (level.places[:, 0] > 4.1).any()


def test_every_stacked_storey_and_its_stair_are_found():
    house = stair_house()
    surface = points_of(house)
    storeys = find_storeys(house, surface)
    assert [level.height for level in storeys.levels] == pytest.approx([0.0, 3.0], abs=0.02)
    path = find_stairs(surface, *storeys.levels)
    assert path[0, 2] < 0.1 and path[-1, 2] > 2.9
    assert (np.diff(path[:, 2]) > -0.01).all()
    steps = path[(path[:, 2] > 0.3) & (path[:, 2] < 2.6)]
    assert len(steps) > 8 and (np.abs(steps[:, 0] - 4.85) < 0.4).all()  # within the width of the stair
    assert np.abs(steps[:, 2] - (steps[:, 1] - 0.8 + 0.13) * 3 / (16 * 0.26)).max() < 0.15


@pytest.mark.parametrize("missing", [(0,), (7,)])
def test_a_stair_is_found_across_treads_that_the_splats_do_not_show(missing):
    house, tread, rise = stair_house(), 0.26, 3.0 / 16
    for k in missing:
        low = (4.2, 0.8 + k * tread - 0.01, k * rise + 0.05)
        house = without(house, low, (5.5, 0.8 + (k + 1) * tread + 0.01, (k + 1) * rise + 0.03))
    surface = points_of(house)
    path = find_stairs(surface, *find_storeys(house, surface).levels)
    assert len(path) and path[0, 2] < 0.1 and path[-1, 2] > 2.9
    steps = path[(path[:, 2] > 0.8) & (path[:, 2] < 2.2)]
    assert (np.abs(steps[:, 0] - 4.85) < 0.56).all()  # within the width of the stair


def test_storeys_without_a_stair_are_not_joined():
    house = joined(two_rooms(), two_rooms(3.0))
    surface = points_of(house)
    assert len(find_stairs(surface, *find_storeys(house, surface).levels)) == 0


def _tiny_box() -> Gaussians:
    return box((0, 0, 0), (0.4, 0.4, 0.4))


def _garden() -> Gaussians:
    return joined(rectangle((0, 0, 0), (20, 0, 0), (0, 20, 0), 0.15), table(3, 3), table(9, 4))


def _walls_only() -> Gaussians:
    walls = two_rooms()
    return Gaussians(*(a[np.abs(walls.means[:, 2] - 1.5) < 1.1] for a in vars(walls).values()))


def _far() -> Gaussians:
    room = two_rooms()
    return replace(room, means=room.means + np.float32(1e5))


def _without_floor() -> Gaussians:
    return without(two_rooms(), (-1, -1, -0.05), (9, 6, 0.05))  # the bed is the largest level surface to stand on


@pytest.mark.parametrize("scene", [_tiny_box, _garden, _walls_only, _far, _without_floor, Gaussians.empty])
def test_scenes_that_are_no_interior_are_refused_with_one_sentence(scene):
    with pytest.raises(InputError, match=r"^room\.ply ") as raised:
        align_scene("room.ply", scene(), "-y", up="z", scale=1.0)
    assert "\n" not in str(raised.value)


def test_floaters_are_found_and_furniture_is_not():
    random, room = np.random.default_rng(0), two_rooms()
    fog = Gaussians(*(a[:60].copy() for a in vars(room).values()))
    fog.means[:] = random.uniform([1.2, 0.8, 0.9], [3.2, 2.2, 1.8], (60, 3))
    fog.log_scales[:], fog.opacity_logits[:] = np.log(0.06), -1.0
    beyond = moved(room, np.eye(3), 1.0)
    beyond.means[:, 0] += 30
    scene = joined(room, fog)
    levels = find_storeys(room, points_of(room)).levels
    found = floaters(scene, levels, 1.5)
    assert found[len(room) :].mean() > 0.8
    assert found[: len(room)].mean() < 0.01
    assert not far_from_floor(room, levels).any() and far_from_floor(beyond, levels).all()


def test_the_inner_gaussians_of_dense_fog_are_found_too():
    random, room = np.random.default_rng(0), two_rooms()
    fog = Gaussians(*(a[:150].copy() for a in vars(room).values()))
    fog.means[:] = random.normal([2.2, 1.5, 1.3], 0.22, (150, 3))
    fog.log_scales[:], fog.opacity_logits[:] = np.log(0.04), -1.0
    found = floaters(joined(room, fog), find_storeys(room, points_of(room)).levels, 1.5)
    assert found[len(room) :].mean() > 0.95  # in one round: 0.57
    assert found[: len(room)].mean() < 0.01


def test_the_cover_of_a_slab_equals_a_sampled_reference():
    random = np.random.default_rng(1)
    g = Gaussians(
        random.uniform([0.3, 0.3, 0], [0.7, 0.7, 0.4], (6, 3)).astype(np.float32),
        np.log(random.uniform(0.03, 0.12, (6, 3))).astype(np.float32),
        random.normal(size=(6, 4)).astype(np.float32),
        random.normal(0, 1, 6).astype(np.float32),
        np.zeros((6, 1, 3), np.float32),
    )
    grid = Grid((0.0, 0.0), 0.05, (20, 20))
    found = slab_cover(g, grid, np.zeros((20, 20)), [(-9.0, 9.0), (0.1, 0.3)])
    from nvsim.geometry.rotation import matrix_from_quaternion

    left = np.ones((2, 20, 20))
    centers = grid.centers()
    for k in range(6):
        axes = matrix_from_quaternion(g.quats[k]) * np.exp(g.log_scales[k])
        full = axes @ axes.T
        own = full[:2, :2] + np.eye(2) * 0.05**2 / 12
        off = centers - g.means[k, :2]
        power = 0.5 * np.einsum("rci,ij,rcj->rc", off, np.linalg.inv(own), off)
        peak = np.sqrt(np.linalg.det(full[:2, :2]) / np.linalg.det(own)) / (1 + np.exp(-g.opacity_logits[k]))
        heights = random.normal(g.means[k, 2], np.sqrt(full[2, 2]), 200_000)
        for slab, (low, high) in enumerate([(-9.0, 9.0), (0.1, 0.3)]):
            left[slab] *= 1 - peak * np.exp(-power) * ((heights > low) & (heights < high)).mean()
    np.testing.assert_allclose(found, 1 - left, atol=0.03)
