"""Planes found in points, and given to the pixels of bare walls."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.depth.config import DepthConfig, LabelConfig
from nvsim.depth.fusion import ObservedPoints
from nvsim.depth.labeling import _visible, label_planes
from nvsim.depth.planes import find_planes
from nvsim.depth.view import View, Warp, census_of
from nvsim.depth.visibility import Carver, add_depth_votes
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.project.ledger import key_of


def room(rng: np.random.Generator) -> ObservedPoints:
    """A room of 6 x 4 x 2.5 m seen from its middle, every face by points with 1 cm of noise."""
    size = np.array([6.0, 4.0, 2.5])
    faces = []
    for axis in range(3):
        for side in (0.0, 1.0):
            points = rng.uniform(0, 1, (6000, 3)) * size
            points[:, axis] = side * size[axis]
            faces.append(points)
    points = np.concatenate(faces) + 0.01 * rng.standard_normal((36000, 3))
    eyes = np.full_like(points, 0.0) + [3.0, 2.0, 1.2]
    return ObservedPoints(points.astype(np.float32), eyes.astype(np.float32), np.full(len(points), 2e4, np.float32))


def test_the_six_faces_of_a_room_are_found_to_the_centimeter() -> None:
    planes = find_planes([room(np.random.default_rng(0))])
    assert len(planes) == 6
    offsets = sorted(round(p.offset, 2) for p in planes)
    assert np.allclose(offsets, [-6.0, -4.0, -2.5, 0.0, 0.0, 0.0], atol=0.01)
    for plane in planes:
        assert plane.normal @ [3.0, 2.0, 1.2] > plane.offset  # it faces those who saw it
        assert np.abs(plane.normal).max() > 0.999
        if abs(plane.normal[2]) < 0.5:  # beyond its border, but neither into the floor nor through the ceiling
            assert np.allclose([plane.low[1], plane.high[1]], [0.0, 2.5], atol=0.04)
            assert plane.high[0] - plane.low[0] > 4.5


def level_points(rng: np.random.Generator, z: float, *areas: tuple[float, float, float, float]) -> ObservedPoints:
    """Points with 1 cm of noise on level rectangles x0, y0, x1, y1 at height z, seen from above the aisle."""
    parts = []
    for x0, y0, x1, y1 in areas:
        part = rng.uniform([x0, y0, z], [x1, y1, z], (int(1500 * (x1 - x0) * (y1 - y0)), 3))
        parts.append(part + 0.01 * rng.standard_normal(part.shape))
    points = np.concatenate(parts).astype(np.float32)
    eyes = np.full_like(points, 0.0) + np.float32([2.0, 1.5, 1.5])
    return ObservedPoints(points, eyes, np.full(len(points), 2e4, np.float32))


def levels_of(*parts: ObservedPoints) -> list[float]:
    joined = [np.concatenate([getattr(p, name) for p in parts]) for name in ("points", "eyes", "say")]
    return sorted(round(float(p.offset), 1) for p in find_planes([ObservedPoints(*joined)]) if p.normal[2] > 0.9)


def test_the_floor_of_an_aisle_between_counters_is_no_reflection_in_their_tops() -> None:
    rng = np.random.default_rng(2)
    tops = level_points(rng, 0.9, (0, 0, 4, 1.15), (0, 1.85, 4, 3))  # one patch: the aisle is 0.7 m wide
    assert levels_of(tops, level_points(rng, 0.0, (0, 1.15, 4, 1.85))) == [0.0, 0.9]


@pytest.mark.parametrize(("depth", "size"), [(-0.7, 1.0), (-2.5, 3.0)], ids=["under a table", "ceiling"])
def test_surfaces_that_a_glossy_floor_mirrors_are_no_planes(depth: float, size: float) -> None:
    rng = np.random.default_rng(3)
    assert levels_of(level_points(rng, 0.0, (0, 0, 4, 3)), level_points(rng, depth, (0, 0, size, size))) == [0.0]


def test_a_floor_that_is_not_above_lower_ground_still_mirrors() -> None:
    """The lower ground belongs to another wing of the building."""
    rng = np.random.default_rng(4)
    wing = level_points(rng, -0.7, (9, 0, 12, 3))
    floor, mirrored = level_points(rng, 0.0, (0, 0, 4, 3)), level_points(rng, -2.5, (0, 0, 3, 3))
    assert levels_of(floor, wing, mirrored) == [-0.7, 0.0]


def test_a_wall_stands_behind_what_hangs_on_it() -> None:
    rng = np.random.default_rng(1)
    found = room(rng)
    # The wall at x = 6 shows itself along its skirting alone; a screen hangs 8 cm before it.
    bare = (found.points[:, 0] > 5.9) & (found.points[:, 2] > 0.2)
    screen = rng.uniform([5.92, 1.2, 0.5], [5.92, 2.8, 1.5], (1500, 3)) + 0.01 * rng.standard_normal((1500, 3))
    points = np.concatenate([found.points[~bare], screen]).astype(np.float32)
    eyes = np.full_like(points, 0.0) + np.float32([3.0, 2.0, 1.2])
    planes = find_planes([ObservedPoints(points, eyes, np.full(len(points), 2e4, np.float32))])
    [wall] = [p for p in planes if p.normal[0] < -0.9 and p.offset < -5]
    assert wall.offset == pytest.approx(-6.0, abs=0.02)


def test_the_planes_of_an_image_are_those_that_its_rays_meet_the_most_covered_first() -> None:
    planes = find_planes([room(np.random.default_rng(0))])
    lens = Intrinsics.from_fov(80, 60, np.radians(80))
    for place, heading in (((2.0, 1.0, 1.2), 0.5), ((5.0, 3.0, 0.4), 4.0), ((-1.0, 2.0, 1.2), np.pi / 2)):
        camera = Camera(lens, camera_pose(np.array(place), heading, -0.1))
        rays = camera.scaled(40, 30).rays().reshape(-1, 3).astype(float)
        shares = []
        for plane in planes:
            away = (plane.offset - camera.position @ plane.normal) / (rays @ plane.normal)
            points = camera.position + away[:, None] * rays
            flat = np.stack([points @ plane.along, points @ plane.up], axis=1)
            met = (away > 0.05) & (away < 20) & ((flat > plane.low) & (flat < plane.high)).all(axis=1)
            shares.append(met.mean() if camera.position @ plane.normal > plane.offset else 0.0)
        expected = [i for i in np.argsort(-np.array(shares), kind="stable") if shares[i] > 0.002]
        assert _visible(camera, planes, LabelConfig()) == expected
        assert _visible(camera, planes, LabelConfig(max_planes=2)) == expected[:2]
    assert len(expected) < 6  # from outside, the nearest wall shows its back
    assert _visible(camera, [], LabelConfig()) == []


def test_a_bare_wall_takes_the_plane_that_its_border_lies_on() -> None:
    planes = find_planes([room(np.random.default_rng(0))])
    lens = Intrinsics(80, 60, 60.0, 60.0, 40.0, 30.0)
    # Toward +x, level: right is -y, down is -z.
    turn = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])

    def view(y: float) -> View:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, (2.0, y, 1.2)
        camera = Camera(lens, pose)
        rays = camera.rays()
        with np.errstate(divide="ignore"):
            wall = 4.0 / rays[..., 0]
            floor = np.where(rays[..., 2] < 0, -1.2 / rays[..., 2], np.inf)
            ceiling = np.where(rays[..., 2] > 0, 1.3 / rays[..., 2], np.inf)
        nearest = np.argmin(np.stack([wall, floor, ceiling]), axis=0)
        gray = np.array([200.0, 90.0, 240.0], np.float32)[nearest]
        return View(camera, gray, census_of(gray, 2.0))

    here, others = view(2.0), [view(1.6), view(2.4)]
    warps = [Warp.between(here.camera, o.camera) for o in others]
    nothing = np.zeros(here.gray.shape, np.float32)
    found, which = label_planes(here, others, warps, nothing, planes, LabelConfig())
    wall = here.gray == 200.0
    assert np.mean(which[wall] >= 0) > 0.86  # the outermost columns are seen from one side alone
    assert np.mean(np.abs(found[wall] * 4.0 - 1) < 0.02) > 0.85


def test_what_shines_in_a_floor_is_no_plane_below_it_and_a_storey_below_is() -> None:
    above = room(np.random.default_rng(0))
    mirror = above.points * [1, 1, -1]  # the room as its floor shows it
    points, eyes = np.concatenate([above.points, mirror]), np.concatenate([above.eyes, above.eyes])
    say = np.concatenate([above.say, above.say])
    offsets = sorted(round(p.offset, 1) for p in find_planes([ObservedPoints(points, eyes, say)]))
    assert np.allclose(offsets, [-6.0, -4.0, -2.5, 0.0, 0.0, 0.0], atol=0.05)
    down = np.float32([0, 0, -3.0])  # seen from within
    storeys = ObservedPoints(
        np.concatenate([above.points, above.points + down]), np.concatenate([above.eyes, above.eyes + down]), say
    )
    floors = sorted(round(p.offset, 1) for p in find_planes([storeys]) if p.normal[2] > 0.9)
    assert np.allclose(floors, [-3.0, 0.0], atol=0.05)


def test_points_that_are_known_well_decide_where_a_plane_lies() -> None:
    rng = np.random.default_rng(1)
    wall = rng.uniform(0, 4, (8000, 3))
    wall[:, 0] = 2.0 + 0.01 * rng.standard_normal(8000)
    wall[400:, 0] += 0.06  # most of it is bare, and lies where smoothing put it
    say = np.full(8000, 1.1e4)
    say[:400] = 1e7
    eyes = np.zeros_like(wall) + [0.0, 2.0, 1.0]
    (found,) = find_planes([ObservedPoints(*(a.astype(np.float32) for a in (wall, eyes, say)))])
    assert abs(found.offset + 2.0) < 0.015


def test_points_that_more_maps_see_through_than_show_are_taken_away() -> None:
    """A wall at 3 m, a leg of 10 cm before it, and points in the air that two of five maps show."""
    lens = Intrinsics(80, 60, 60.0, 60.0, 40.0, 30.0)
    across, up = np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.5, 0.5, 11))
    wall = np.stack([across.ravel(), up.ravel(), np.full(99, 3.0)], axis=1)
    leg = np.array([[0.75, y, 2.0] for y in (-0.3, 0.0, 0.3)])
    air = np.array([[0.1, 0.1, 1.2], [-0.2, 0.0, 2.0]])
    cameras, maps = [], []
    for k in range(5):
        pose = np.eye(4)
        pose[0, 3] = 0.1 * k - 0.2
        camera = Camera(lens, pose)
        depth = np.full((60, 80), 3.0, np.float32)
        x = pose[0, 3] + 2.0 * camera.rays()[..., 0] / camera.rays()[..., 2]
        depth[np.abs(x - 0.75) < 0.05] = 2.0
        if k < 2:
            pixels, at = camera.project(air)
            depth[pixels[:, 1].astype(int), pixels[:, 0].astype(int)] = at
        cameras.append(camera)
        maps.append((1 / depth).astype(np.float32))
    points = np.concatenate([wall, leg, air, [[0.0, 0.0, -1.0]]]).astype(np.float32)
    kept = Carver(cameras, maps.__getitem__, 2).exists(points)
    assert kept[:102].all() and not kept[102:104].any()
    assert kept[104]  # behind all cameras: nothing speaks against it


def test_points_out_of_sight_of_a_map_are_skipped_and_all_others_are_counted() -> None:
    """Maps with edges and unknown pixels in a hall: the votes of blocks equal those of all points."""
    rng = np.random.default_rng(4)
    points = rng.uniform((-20, -15, 0), (20, 15, 3), (6000, 3)).astype(np.float32)
    lens = Intrinsics(80, 60, 60.0, 60.0, 35.0, 32.0)
    cameras = [
        Camera(lens, camera_pose(rng.uniform((-18, -13, 1), (18, 13, 2)), rng.uniform(0, 6.3), rng.uniform(-0.6, 0.3)))
        for _ in range(30)
    ]
    maps = []
    for k in range(len(cameras)):
        depth = np.repeat(np.repeat(rng.uniform(1, 4 + k % 7, (6, 8)), 10, axis=0), 10, axis=1)
        maps.append(np.where(rng.uniform(size=depth.shape) < 0.1, 0, 1 / depth).astype(np.float32))
    shown, through = np.zeros((2, len(points)), np.int64)
    for camera, inverse in zip(cameras, maps, strict=True):
        add_depth_votes(points, camera, inverse, shown, through)
    expected = shown >= 2 * through
    assert (shown > 0).sum() > 100 and (~expected).sum() > 300
    carver = Carver(cameras, maps.__getitem__, 2)
    for _ in range(2):  # the second time, the distances of the farthest votes are known
        np.testing.assert_array_equal(carver.exists(points), expected)


def test_a_thin_top_stays_that_few_near_cameras_show_and_many_far_ones_look_past() -> None:
    lens = Intrinsics(80, 60, 60.0, 60.0, 40.0, 30.0)
    top = np.array([[x, 0.0, 10.0] for x in (-0.2, 0.0, 0.2)], np.float32)
    cameras, maps = [], []
    for z in (8.0, 8.5, *np.linspace(0, 3, 8)):  # two within 2 m, eight from 7 m on, who see the wall behind
        pose = np.eye(4)
        pose[2, 3] = z
        cameras.append(Camera(lens, pose))
        maps.append(np.full((60, 80), 1 / ((10.0 if z >= 8 else 14.0) - z), np.float32))
    assert Carver(cameras, maps.__getitem__, 2).exists(top).all()
    assert not Carver(cameras[2:] + cameras[:1], (maps[2:] + maps[2:3]).__getitem__, 2).exists(top).any()


@pytest.mark.parametrize("setting", ["planes", "nearest", "longest_side", "threads", "voxel", "noise"])
def test_a_setting_that_makes_no_sense_is_one_sentence(setting: str) -> None:
    with pytest.raises(InputError, match=rf"^Depth configuration: .*{setting}.*; change it and try again\.$"):
        DepthConfig(**{setting: 0})


def test_constants_identify_a_result_and_the_number_of_threads_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    assert key_of(DepthConfig(threads=7).key) == "94d033b987643284569f8cc3", "stored results would look outdated"
    assert DepthConfig(steps=2).key != DepthConfig().key
    monkeypatch.setattr(DepthConfig, "labels", LabelConfig(max_planes=23))
    assert key_of(DepthConfig().key) != "94d033b987643284569f8cc3"
