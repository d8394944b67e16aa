"""Gaussians that are wide for their depth, against the least exponent along each ray in double precision."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.by_rays import draw_by_rays, is_wide
from nvsim.render.kernel_types import EPS2D
from nvsim.render.model import render_gaussians
from nvsim.render.scene import render_regions
from nvsim.splats.types import Gaussians, SubmapModel

GEOMETRY = frozenset({"alpha", "depth", "normal"})


def around_the_eye(seed: int, count: int, widest: float = 0.6) -> Gaussians:
    """Gaussians within two meters of the origin, wide and thin, opaque and faint."""
    r = np.random.default_rng(seed)
    scales = np.log(r.uniform(0.02, widest, (count, 3)) * [1, 1, 0.1])
    arrays = (r.uniform(-2, 2, (count, 3)), scales, r.normal(size=(count, 4)), r.normal(0, 2, count))
    return Gaussians(*(np.ascontiguousarray(a, np.float32) for a in (*arrays, r.normal(size=(count, 1, 3)))))


def camera(heading: float = 0.4, pitch: float = -0.8, size: tuple[int, int] = (50, 36)) -> Camera:
    return Camera(Intrinsics.from_fov(*size, np.radians(100)), camera_pose(np.array([0.1, -0.2, 0.05]), heading, pitch))


def by_the_book(gaussians: Gaussians, view: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The result of `draw_by_rays`, computed pixel by pixel."""
    k, pose = view.intrinsics, view.world_to_camera
    u, v = np.meshgrid(np.arange(k.width) + 0.5, np.arange(k.height) + 0.5)
    rays = np.dstack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones_like(u)]) @ pose[:3, :3]  # world, of depth 1
    through = np.ones((k.height, k.width))
    depth, normal = np.zeros_like(through), np.zeros((3, k.height, k.width))
    centers = gaussians.means.astype(float) - view.position
    for i in np.argsort(np.linalg.norm(centers, axis=1)):
        axes = Rotation.from_quat(gaussians.quats[i, [1, 2, 3, 0]]).as_matrix()
        thinnest = np.sqrt(EPS2D) * (pose[:3, :3] @ centers[i])[2] / max(k.fx, k.fy)
        scale = np.maximum(np.exp(gaussians.log_scales[i].astype(float)), thinnest)
        o, d = (centers[i] @ axes) / scale, (rays @ axes) / scale
        nearest = (d @ o) / (d * d).sum(axis=-1)
        away = ((o - nearest[..., None] * d) ** 2).sum(axis=-1)
        alpha = np.exp(-0.5 * away) / (1 + np.exp(-float(gaussians.opacity_logits[i])))
        weight = np.where((alpha >= 1 / 255) & (nearest > 0), np.minimum(alpha, 0.99), 0) * through
        short = axes[:, gaussians.log_scales[i].argmin()]
        through = through - weight
        depth += weight * nearest
        normal += weight * (short * (-1 if short @ centers[i] > 0 else 1))[:, None, None]
    return through, depth, normal


@pytest.mark.parametrize("seed", range(8))
def test_alpha_depth_and_normal_are_those_of_the_nearest_point_of_every_ray(seed: int) -> None:
    gaussians, view = around_the_eye(seed, 12), camera(pitch=-0.3 * seed)
    k = view.intrinsics
    found = draw_by_rays(gaussians, view, np.ones((-(-k.height // 16), -(-k.width // 16)), bool))
    for ours, theirs in zip(found, by_the_book(gaussians, view), strict=True):
        off = np.abs(ours - theirs)
        # Where alpha is all but 1/255, single precision may draw what double precision does not.
        assert np.quantile(off, 0.98) < 5e-4 and off.max() < 0.05


def test_nothing_is_drawn_outside_the_wanted_tiles() -> None:
    gaussians, wanted = around_the_eye(0, 12), np.zeros((3, 4), bool)
    whole = draw_by_rays(gaussians, camera(), ~wanted)[0]
    wanted[0, 0] = True
    through, depth, normal = draw_by_rays(gaussians, camera(), wanted)
    inside = np.zeros(through.shape, bool)
    inside[:16, :16] = True
    assert (through[inside] == whole[inside]).all() and (whole[inside] < 1).any()
    assert (through[~inside] == 1).all() and not depth[~inside].any() and not normal[:, ~inside].any()


def test_a_wall_beside_the_eye_does_not_lie_over_the_floor_at_its_feet() -> None:
    y, z = np.meshgrid(np.arange(-2, 3, 0.2), np.arange(-1.4, 1, 0.2))
    means = np.stack([np.full(y.size, -0.6), y.ravel(), z.ravel()], axis=1)
    scales, quats = np.log([[0.01, 0.2, 0.2]]).repeat(len(means), 0), np.array([[1, 0, 0, 0]]).repeat(len(means), 0)
    wall = Gaussians(
        *(np.ascontiguousarray(a, np.float32) for a in (means, scales, quats, np.full(len(means), 2.0))),
        np.zeros((len(means), 1, 3), np.float32),
    )
    eye = Camera(Intrinsics.from_fov(192, 192, np.radians(100)), camera_pose(np.zeros(3), 0.0, -np.pi / 4))
    floor = np.zeros((192, 192), bool)
    floor[120:185, 80:112] = True  # 0.1 to 0.9 m ahead, 0.3 m to either side
    splatted = render_gaussians(wall, eye, GEOMETRY)
    cast = render_regions(SubmapModel(wall, None, None, FloorSurface.flat(0.0)), [eye], [np.ones_like(floor)], GEOMETRY)
    assert splatted.alpha is not None and cast[0].alpha is not None and cast[0].depth is not None
    assert splatted.alpha[floor].mean() > 0.2
    assert cast[0].alpha[floor].max() < 0.01
    assert cast[0].alpha[100, 5] > 0.9, "the wall itself is there"
    ray = eye.rays()[100, 5]
    assert cast[0].depth[100, 5] == pytest.approx(-0.6 / ray[0] * (ray @ eye.rotation[:, 2]), rel=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_drawn_by_rays_lies_before_what_is_splatted(seed: int) -> None:
    """All of them by rays differ from some of them by rays by no more than splatting errs."""
    near, view = around_the_eye(seed, 6, widest=0.4), camera(size=(64, 64))
    r = np.random.default_rng(seed)
    far = around_the_eye(seed + 10, 60)
    far.means[:] = view.position + 3.0 * view.rotation[:, 2] + 0.5 * far.means
    far.log_scales[:] = np.log(r.uniform(0.15, 0.25, far.log_scales.shape))
    fields = ("means", "log_scales", "quats", "opacity_logits", "sh")
    both = Gaussians(*(np.concatenate([getattr(g, f) for g in (near, far)]) for f in fields))
    wide = is_wide(both, np.arange(len(both)), view)
    assert 0 < wide.sum() < 30
    model = SubmapModel(both, None, None, FloorSurface.flat(0.0))
    mixed = render_regions(model, [view], [np.ones((64, 64), bool)], GEOMETRY)[0]
    ahead = both.means @ view.world_to_camera[2, :3] + view.world_to_camera[2, 3] > 0.05
    through, depth, normal = by_the_book(Gaussians(*(getattr(both, f)[ahead] for f in fields)), view)
    assert mixed.alpha is not None and mixed.normal is not None and mixed.depth is not None
    assert np.abs(mixed.alpha - (1 - through)).mean() < 0.01
    assert np.abs(mixed.normal - np.moveaxis(normal, 0, -1)).mean() < 0.02
    assert np.abs(mixed.depth * mixed.alpha - depth).mean() < 0.05


def test_who_asks_for_colors_as_well_sees_the_same_of_what_stands() -> None:
    model, view = SubmapModel(around_the_eye(3, 40), None, None, FloorSurface.flat(0.0)), camera()
    mask = [np.ones((36, 50), bool)]
    alone = render_regions(model, [view], mask, GEOMETRY)[0]
    both = render_regions(model, [view], mask, GEOMETRY | {"rgb"})[0]
    for channel in GEOMETRY:
        np.testing.assert_array_equal(getattr(both, channel), getattr(alone, channel))
    assert both.rgb is not None and alone.rgb is None and both.rgb.any()
