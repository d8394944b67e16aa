"""The tiled rasterizer compared with the slow reference: its result, the order, threads, and unusual input."""

from __future__ import annotations

import subprocess
import sys

import numba
import numpy as np
import pytest
import reference_splatting as reference
import torch

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.render.model import render_gaussians
from nvsim.splats import harmonics
from nvsim.splats.types import Gaussians

ALL = frozenset({"rgb", "alpha", "depth", "normal"})
CAMERAS = {
    "centred": Camera(Intrinsics(64, 48, 55.0, 55.0, 32.0, 24.0), camera_pose(np.array([0.0, 0.0, 1.5]), 0.0)),
    "off-centre, size not of whole tiles": Camera(
        Intrinsics(67, 43, 52.0, 60.0, 20.0, 31.5), camera_pose(np.array([0.4, -0.3, 1.2]), 0.7, -0.3)
    ),
}


def scene(camera, count=400, degree=3, seed=0):
    r = np.random.default_rng(seed)
    local = r.uniform([-2, -1.5, 0.4], [2, 1.5, 7.0], (count, 3))
    local[:, :2] *= local[:, 2:] / 3
    f = np.float32
    return Gaussians(
        (local @ camera.rotation.T + camera.position).astype(f),
        r.normal(-2.6, 0.8, (count, 3)).astype(f),
        r.normal(size=(count, 4)).astype(f),
        r.normal(0, 2, count).astype(f),
        r.normal(0, 0.3, (count, (degree + 1) ** 2, 3)).astype(f),
    )


def expected(g, camera, antialiased):
    arrays = (g.means, g.log_scales, g.quats, g.opacity_logits, g.sh)
    return [t.numpy() for t in reference.splat(*(torch.tensor(a).double() for a in arrays), camera, antialiased)]


def psnr(a, b, peak=1.0):
    return 10 * np.log10(peak**2 / np.mean((a.astype(np.float64) - b) ** 2))


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("antialiased", [True, False])
def test_every_channel_equals_the_reference(name, antialiased):
    camera = CAMERAS[name]
    g = scene(camera)
    output = render_gaussians(g, camera, ALL, antialiased)
    rgb, alpha, depth, normal = expected(g, camera, antialiased)
    assert psnr(output.rgb, rgb) > 70
    assert psnr(output.alpha, alpha) > 70
    assert psnr(output.depth, depth, peak=7) > 60
    assert psnr(output.normal, normal) > 70


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_every_sh_degree_equals_the_reference(degree):
    camera = CAMERAS["centred"]
    g = scene(camera, count=100, degree=degree)
    assert psnr(render_gaussians(g, camera).rgb, expected(g, camera, True)[0]) > 70


def test_an_opaque_crowd_stops_early_without_showing_it():
    camera = CAMERAS["centred"]
    g = scene(camera, count=3000)
    g.opacity_logits += 3
    g.log_scales += 1
    assert psnr(render_gaussians(g, camera).rgb, expected(g, camera, True)[0]) > 60


def test_only_the_asked_channels_come_back():
    camera = CAMERAS["centred"]
    output = render_gaussians(scene(camera, 20), camera, frozenset({"alpha"}))
    assert output.alpha is not None
    assert output.rgb is None and output.depth is None and output.normal is None
    with pytest.raises(ValueError, match="colour"):
        render_gaussians(scene(camera, 20), camera, frozenset({"colour"}))


def test_a_wall_has_its_depth_and_faces_the_camera():
    camera = CAMERAS["centred"]
    x, z = np.meshgrid(np.linspace(-3, 3, 60), np.linspace(-1, 4, 50))
    n = x.size
    f = np.float32
    wall = Gaussians(
        np.stack([x.ravel(), np.full(n, 4.0), z.ravel()], 1).astype(f),
        np.log(np.tile([0.1, 0.002, 0.1], (n, 1))).astype(f),
        np.tile([1, 0, 0, 0], (n, 1)).astype(f),
        np.full(n, 4, f),
        np.zeros((n, 1, 3), f),
    )
    output = render_gaussians(wall, camera, ALL)
    np.testing.assert_allclose(output.depth, 4, atol=1e-3)
    np.testing.assert_allclose(output.normal, np.broadcast_to([0, -1, 0], output.normal.shape), atol=1e-2)


def test_nothing_is_drawn_of_an_empty_scene_or_behind_the_camera():
    camera = CAMERAS["centred"]
    behind = scene(camera, 50)
    behind.means = (2 * camera.position - behind.means).astype(np.float32)
    for g in (Gaussians.empty(3), behind):
        output = render_gaussians(g, camera, ALL)
        for image in (output.rgb, output.alpha, output.depth, output.normal):
            assert not image.any()


def test_gaussians_that_are_not_finite_are_left_out():
    camera = CAMERAS["centred"]
    g = scene(camera, 90)
    broken = scene(camera, 90)
    values = (np.nan, np.inf, -np.inf)
    for i in range(0, 90, 3):
        array = (broken.means, broken.log_scales, broken.quats)[i % 2 if i % 6 else 2]
        array[i, 0] = values[(i // 3) % 3]
        g.opacity_logits[i] = -20
    broken.opacity_logits[::3] = np.where(np.arange(30) % 4, broken.opacity_logits[::3], np.nan)
    finite = np.isfinite(render_gaussians(broken, camera, ALL).rgb).all()
    assert finite


def test_images_are_the_same_for_any_number_of_threads_and_every_time():
    camera = CAMERAS["centred"]
    g = scene(camera, 2000)
    threads = numba.get_num_threads()
    try:
        images = []
        for count in {1, threads}:
            numba.set_num_threads(count)
            images += [render_gaussians(g, camera, ALL) for _ in range(2)]
    finally:
        numba.set_num_threads(threads)
    for other in images[1:]:
        np.testing.assert_array_equal(other.rgb, images[0].rgb)
        np.testing.assert_array_equal(other.normal, images[0].normal)


def test_the_basis_is_that_of_scipy_up_to_degree_four():
    d = np.random.default_rng(0).normal(size=(200, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    truth = reference.real_basis(torch.tensor(d), 4).numpy()
    np.testing.assert_allclose(harmonics.basis(d, 4), truth, atol=2e-6)


def test_rendering_does_not_import_torch_or_qt():
    code = (
        "import sys, nvsim.render.scene, nvsim.render.panorama, nvsim.splats.files;"
        "assert not {'torch', 'PySide6', 'cv2'} & set(sys.modules), 'heavy import'"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
