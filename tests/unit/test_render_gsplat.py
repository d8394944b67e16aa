"""The contract of the backends, and what the gsplat backend hands over.

Without a CUDA card gsplat's rasterization is stood in for, see `gsplat_reference`: that checks everything but its
kernels.
"""

from __future__ import annotations

import gc

import numpy as np
import pytest
import torch
from gsplat_reference import INSTALLED, stand_in
from test_render_forward import ALL, CAMERAS, expected, psnr, scene

from nvsim.errors import InputError
from nvsim.render import backends
from nvsim.render.model import render_gaussians
from nvsim.splats.types import Gaussians

needs_gsplat = pytest.mark.skipif(not INSTALLED, reason="gsplat is not installed")
needs_cuda = pytest.mark.skipif(not (INSTALLED and torch.cuda.is_available()), reason="no gsplat or no CUDA card")


@pytest.fixture(params=["numba", pytest.param("stand-in", marks=needs_gsplat), pytest.param("cuda", marks=needs_cuda)])
def render(request, monkeypatch):
    if request.param == "numba":
        return lambda *a: render_gaussians(*a, backend="numba")
    if request.param == "cuda":
        return lambda *a: render_gaussians(*a, backend="gsplat")
    from nvsim.render import gsplat_backend

    stand_in(monkeypatch)

    def on_cpu(gaussians, camera, channels=frozenset({"rgb", "alpha"}), antialiased=True):
        return gsplat_backend.render_over(gaussians, camera, channels, antialiased, device="cpu")[0]

    return on_cpu


def tame(camera, count=250):
    """Below the alpha at which the backends cap differently."""
    g = scene(camera, count)
    g.opacity_logits = np.minimum(g.opacity_logits, 2).astype(np.float32)
    return g


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("antialiased", [True, False])
def test_every_backend_draws_every_channel_as_the_reference(render, name, antialiased):
    camera = CAMERAS[name]
    g = tame(camera)
    output = render(g, camera, ALL, antialiased)
    rgb, alpha, depth, normal = expected(g, camera, antialiased)
    assert psnr(output.rgb, rgb) > 45
    assert psnr(output.alpha, alpha) > 45
    assert psnr(output.depth, depth, peak=7) > 45
    assert psnr(output.normal, normal) > 45


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_every_backend_takes_harmonics_of_a_lower_degree(render, degree):
    camera = CAMERAS["centred"]
    g = scene(camera, count=60, degree=degree)
    assert psnr(render(g, camera).rgb, expected(g, camera, True)[0]) > 45


@pytest.mark.parametrize("name", sorted(ALL))
def test_every_backend_gives_one_channel_alone(render, name):
    camera = CAMERAS["centred"]
    g = tame(camera, 80)
    alone, whole = render(g, camera, frozenset({name})), render(g, camera, ALL)
    np.testing.assert_allclose(getattr(alone, name), getattr(whole, name), atol=1e-5)
    assert all(getattr(alone, other) is None for other in ALL - {name})


def test_every_backend_leaves_out_what_is_not_finite(render):
    camera = CAMERAS["centred"]
    g = tame(camera, 60)
    g.opacity_logits[::3] = -20
    clean = render(g, camera, ALL)
    for i, array in enumerate((g.means, g.log_scales, g.quats)):
        array[3 * i, 0] = (np.nan, np.inf, -np.inf)[i]
    output = render(g, camera, ALL)
    for name in ALL:
        np.testing.assert_allclose(getattr(output, name), getattr(clean, name), atol=1e-5)


def test_every_backend_draws_nothing_of_nothing(render):
    output = render(Gaussians.empty(3), CAMERAS["centred"], ALL)
    assert not any(getattr(output, name).any() for name in ALL)


def test_without_a_card_auto_is_the_cpu_and_gsplat_is_refused(monkeypatch):
    monkeypatch.setattr(backends, "missing_for_gsplat", lambda: "PyTorch sees no CUDA card")
    assert backends.resolve_backend("auto") == backends.resolve_backend("numba") == "numba"
    with pytest.raises(InputError, match="no CUDA card.*numba"):
        render_gaussians(Gaussians.empty(), CAMERAS["centred"], backend="gsplat")
    monkeypatch.setattr(backends, "missing_for_gsplat", lambda: None)
    assert backends.resolve_backend("auto") == "gsplat"


@needs_gsplat
def test_what_lasts_is_uploaded_once_and_freed_with_its_gaussians(monkeypatch):
    from nvsim.render import gsplat_backend

    uploads = []
    upload = gsplat_backend.upload
    monkeypatch.setattr(gsplat_backend, "upload", lambda g, device: uploads.append(1) or upload(g, device))
    monkeypatch.setattr(gsplat_backend, "_render", lambda *a: None)
    g, camera = tame(CAMERAS["centred"], 20), CAMERAS["centred"]
    for lasting in (True, True, False, False):
        gsplat_backend.render_over(g, camera, ALL, True, lasting, device="cpu")
    assert len(uploads) == 3 and len(gsplat_backend._uploaded) == 1
    del g
    gc.collect()
    assert len(gsplat_backend._uploaded) == 0
