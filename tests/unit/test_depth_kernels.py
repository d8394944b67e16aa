"""The kernels of depth against slow references, and against planes whose depth is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from nvsim.depth.agreement import compare_depth_maps
from nvsim.depth.refinement import refine, smooth_depth
from nvsim.depth.smoothing import best_inverse_depth, smooth_cost
from nvsim.depth.sweep import WORST, sweep, turned_census
from nvsim.depth.view import View, Warp, census_of, neighbors
from nvsim.geometry.camera import Camera, Intrinsics

LENS = Intrinsics(96, 72, 80.0, 80.0, 48.0, 36.0)


def camera_at(x: float, y: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Camera:
    """Looks along the world's z, a pose that is as good as any."""
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(np.array([0.0, yaw, 0.0]))[0]
    pose[:3, 3] = x, y, z
    return Camera(LENS, pose)


def wall_seen_by(camera: Camera, rng_seed: int = 3) -> tuple[View, np.ndarray]:
    """A textured wall, slanted: z = 3 + 0.2 x; the view and its true inverse depth."""
    rng = np.random.default_rng(rng_seed)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (512, 512)).astype(np.float32), (0, 0), 2.0)
    texture = (texture - texture.mean()) * 4 + 128
    rays = camera.rays().astype(np.float64)
    along = (3 + 0.2 * camera.position[0] - camera.position[2]) / (rays[..., 2] - 0.2 * rays[..., 0])
    points = camera.position + along[..., None] * rays
    image = cv2.remap(
        texture,
        (256 + 40 * points[..., 0]).astype(np.float32),
        (256 + 40 * points[..., 1]).astype(np.float32),
        cv2.INTER_LINEAR,
    )
    depth = ((points - camera.position) @ camera.rotation)[..., 2]
    return View(camera, image, census_of(image, 2.0)), (1 / depth).astype(np.float32)


@pytest.fixture(scope="module")
def wall() -> tuple[View, np.ndarray, list[View], list[Warp]]:
    here = camera_at(0.0)
    others = [camera_at(0.4, yaw=0.03), camera_at(-0.4), camera_at(0.1, 0.3, 0.1), camera_at(-0.1, -0.3, 0.1)]
    view, truth = wall_seen_by(here)
    return view, truth, [wall_seen_by(c)[0] for c in others], [Warp.between(here, c) for c in others]


def swept(wall: tuple[View, np.ndarray, list[View], list[Warp]], planes: int) -> tuple[np.ndarray, np.ndarray]:
    view, _, sources, warps = wall
    inverse = np.linspace(0.1, 0.8, planes)
    turned, shifts = np.stack([w.turned for w in warps]), np.stack([w.shift for w in warps])
    return sweep(view.census, [s.gray for s in sources], turned, shifts, inverse, 2.0), inverse


def test_the_sweep_counts_the_bits_that_differ_in_the_best_two_images(wall) -> None:
    view, _, sources, warps = wall
    straight = wall[0], wall[1], sources[1:], warps[1:]  # not turned, so that their own census is what counts
    cost, inverse = swept(straight, 8)
    rng = np.random.default_rng(0)
    same = 0
    for _ in range(300):
        y, x, d = rng.integers(72), rng.integers(96), rng.integers(8)
        found = []
        for source, warp in zip(sources[1:], warps[1:], strict=True):
            p = warp.turned @ [x, y, 1.0] + inverse[d] * warp.shift
            u, v = np.rint(p[:2] / p[2]).astype(int)
            if 0 <= u < 96 and 0 <= v < 72:
                found.append(bin(int(view.census[y, x]) ^ int(source.census[v, u])).count("1"))
            else:
                found.append(WORST)
        same += int(cost[y, x, d]) == sum(sorted(min(f, WORST) for f in found)[:2])
    assert same >= 295  # where a pixel falls between two, rounding may differ


@pytest.mark.parametrize("yaw", [0.1, -0.5])
def test_a_turned_image_is_what_the_camera_would_see_had_it_not_been_turned(yaw: float) -> None:
    straight = camera_at(0.4)
    seen, turned = wall_seen_by(straight)[0], wall_seen_by(camera_at(0.4, yaw=yaw))[0]
    warp = Warp.between(straight, turned.camera)
    census, left, top = turned_census(turned.gray, warp.turned, 96, 72, 2.0)
    rows, columns = (np.arange(5, n - 5) for n in (72, 96))
    columns = columns[(columns - left + 1 >= 0) & (columns - left + 1 < census.shape[1])]
    theirs = census[np.ix_(rows - top + 1, columns - left + 1)]
    there = theirs != np.uint64(0xFFFFFFFFFFFFFFFF)
    differ = np.bitwise_count(theirs ^ seen.census[np.ix_(rows, columns)])[there]
    assert there.mean() > 0.5 and np.mean(differ) < 4  # of 64; images that are not turned differ by 25


def test_the_census_says_which_pixels_are_clearly_brighter_or_darker() -> None:
    gray = np.random.default_rng(2).uniform(0, 9, (12, 15)).astype(np.float32)
    found = census_of(gray, 2.0)
    padded = np.pad(gray, ((3, 3), (4, 4)), mode="edge")
    around = [(dy, dx) for dy in (-3, -1, 0, 1, 3) for dx in (-4, -2, -1, 0, 1, 2, 4) if dy or abs(dx) in (1, 2)]
    for y, x in np.ndindex(gray.shape):
        bits = 0
        for dy, dx in around:
            difference = padded[y + 3 + dy, x + 4 + dx] - gray[y, x]
            bits = bits << 2 | int(difference > 2.0) | int(difference < -2.0) << 1
        assert found[y, x] == bits


def test_smooth_depths_keep_their_steps_and_their_holes() -> None:
    rng = np.random.default_rng(4)
    true = np.full((40, 60), 0.5, np.float32)
    true[:, 30:] = 0.8
    noisy = true + 0.01 * rng.standard_normal(true.shape).astype(np.float32)
    noisy[10:14, 10:14] = 0
    found = smooth_depth(noisy, 2.0, 0.03)
    known = noisy > 0
    assert np.array_equal(found > 0, known)
    assert np.abs(found - true)[known].max() < 0.03
    assert np.std((found - true)[known]) < 0.4 * np.std((noisy - true)[known])


def test_smoothing_is_the_recurrence_along_eight_directions() -> None:
    rng = np.random.default_rng(1)
    cost = rng.integers(0, 40, (6, 7, 5)).astype(np.uint8)
    guide = rng.uniform(0, 20, (6, 7)).astype(np.float32)
    expected = np.zeros((6, 7, 5))
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        path = np.zeros((6, 7, 5))
        for y in range(6) if dy >= 0 else range(5, -1, -1):
            for x in range(7) if dx >= 0 else range(6, -1, -1):
                v, u = y - dy, x - dx
                path[y, x] = cost[y, x]
                if 0 <= v < 6 and 0 <= u < 7:
                    before = path[v, u] - path[v, u].min()
                    price = int(max(4 + 2.0, 30.0 / (1 + abs(float(guide[y, x]) - float(guide[v, u])) / 5.0)))
                    padded = np.pad(before, 1, constant_values=1e9)
                    path[y, x] += np.minimum(np.minimum(before, np.minimum(padded[:-2], padded[2:]) + 4), price)
        expected += path
    assert np.array_equal(smooth_cost(cost, guide, 4, 30.0, 5.0), expected)


def test_a_slanted_wall_is_found_to_within_two_per_cent(wall) -> None:
    cost, inverse = swept(wall, 64)
    view, truth, sources, warps = wall
    found, margin = best_inverse_depth(smooth_cost(cost, view.gray, 4, 40.0, 8.0), inverse.astype(np.float32))
    error = np.abs(found / truth - 1)[8:-8, 8:-8]
    assert np.median(error) < 0.015 and np.mean(error < 0.05) > 0.95 and np.median(margin) > 0.1


def test_a_step_of_refinement_halves_the_error_and_knows_where_it_can(wall) -> None:
    view, truth, sources, warps = wall
    turned, shifts = np.stack([w.turned for w in warps]), np.stack([w.shift for w in warps])
    start = (truth * 1.02).astype(np.float32)
    better, knowledge = refine(view.gray, [s.gray for s in sources], turned, shifts, start, 7, 0.02, 2.0)
    before, after = (np.abs(w / truth - 1)[8:-8, 8:-8] for w in (start, better))
    assert np.median(after) < 0.5 * np.median(before)
    bare = np.full_like(view.gray, 100.0)
    same, nothing = refine(bare, [bare] * 4, turned, shifts, start, 7, 0.02, 2.0)
    assert np.array_equal(same, start) and nothing.max() < 1e-3 * np.median(knowledge)


def test_depths_count_that_other_views_have_too_and_not_those_seen_through(wall) -> None:
    view, truth, sources, warps = wall
    maps = [(wall_seen_by(s.camera)[1], np.ones(truth.shape, np.float32), w) for s, w in zip(sources, warps)]
    wrong = truth.copy()
    wrong[20:40, 30:50] *= 1.5
    found = compare_depth_maps(wrong, np.ones_like(truth), maps, 0.02, 0.002)
    inside = np.s_[22:38, 32:48]
    assert found.views[inside].max() == 0 and found.through[inside].min() >= 3
    good = found.views >= 3
    assert good.mean() > 0.5 and np.abs(found.inverse / truth - 1)[good].max() < 0.01


def test_neighbors_look_the_same_way_from_another_place() -> None:
    poses = np.stack([camera_at(x).camera_to_world for x in (0.0, 0.01, 0.5, 0.6, 9.0)])
    poses = np.concatenate([poses, camera_at(0.6, yaw=2.0).camera_to_world[None]])
    assert neighbors(poses, 0, 4, 0.6) == [3, 2]  # 2 is only then far enough from 3 when cameras may be nearer
    assert neighbors(poses[:2], 0, 4, 0.6) == []
