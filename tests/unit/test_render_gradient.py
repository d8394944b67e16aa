"""The hand-written gradients of the rasteriser against torch's own, through a reference that shares no code with it."""

from __future__ import annotations

import numpy as np
import pytest
import reference_splatting as reference
import torch

from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.render.autograd import Statistics, rasterize

NAMES = ("means", "log_scales", "quats", "opacity_logits", "sh")
CAMERA = Camera(Intrinsics(41, 35, 30.0, 33.0, 17.0, 20.5), look(np.array([0.3, -0.4, 1.2]), 0.4, -0.1))


def scene(count=60, degree=3, seed=0):
    r = np.random.default_rng(seed)
    local = r.uniform([-1.6, -1.3, 0.8], [1.6, 1.3, 5.0], (count, 3)) * [1, 1, 1]
    local[:, :2] *= local[:, 2:] / 2.5
    means = local @ CAMERA.rotation.T + CAMERA.position
    return [
        torch.tensor(a, dtype=torch.float32)
        for a in (
            means,
            r.normal(-2.2, 0.6, (count, 3)),
            r.normal(size=(count, 4)) * 1.7,
            r.normal(0.5, 1.5, count),
            r.normal(0, 0.3, (count, (degree + 1) ** 2, 3)),
        )
    ]


def weights(seed=1):
    r = torch.Generator().manual_seed(seed)
    h, w = CAMERA.intrinsics.height, CAMERA.intrinsics.width
    return torch.randn(h, w, 3, generator=r), torch.randn(h, w, generator=r), torch.randn(h, w, generator=r) * 0.1


def gradients(function, tensors, **options):
    leaves = [t.clone().requires_grad_() for t in tensors]
    outputs = function(*leaves, CAMERA, **options)
    loss = sum((o * g.to(o.dtype)).sum() for o, g in zip(outputs, weights()))
    return torch.autograd.grad(loss, leaves)


def relative(a, b):
    return float((a.double() - b).norm() / b.norm())


@pytest.mark.parametrize("antialiased", [True, False])
def test_gradients_of_colour_alpha_and_depth_equal_those_of_the_reference(antialiased):
    tensors = scene()
    expected = gradients(reference.splat, [t.double() for t in tensors], antialiased=antialiased)
    found = gradients(rasterize, tensors, antialiased=antialiased, depth=True)
    for name, a, b in zip(NAMES, found, expected):
        assert relative(a, b) < 2e-3, name
