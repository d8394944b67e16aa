"""Drawing by gsplat with gradients, held to the numba kernels."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from gsplat_reference import INSTALLED, stand_in
from test_render_forward import CAMERAS, scene

from nvsim.render import autograd

pytestmark = pytest.mark.skipif(not INSTALLED, reason="gsplat is not installed")


@pytest.mark.parametrize("antialiased", [True, False])
@pytest.mark.parametrize("sh_degree", [None, 1])
def test_gsplat_gives_the_images_gradients_and_statistics_of_the_kernels(
    monkeypatch: pytest.MonkeyPatch, antialiased: bool, sh_degree: int | None
) -> None:
    stand_in(monkeypatch)
    from nvsim.render import gsplat_backend

    camera = CAMERAS["centred"]
    g = scene(camera, 80)
    g.opacity_logits = np.minimum(g.opacity_logits, 2).astype(np.float32)  # below where alpha is capped differently
    arrays = (g.means, g.log_scales, g.quats, g.opacity_logits, g.sh)
    ours = [torch.tensor(a, requires_grad=True) for a in arrays]
    theirs = [torch.tensor(a, requires_grad=True) for a in arrays]
    statistics = autograd.Statistics.zeros(len(g))
    rgb, alpha = autograd.rasterize(*ours, camera, antialiased=antialiased, sh_degree=sh_degree, statistics=statistics)
    drawn = gsplat_backend.rasterize(*theirs, camera=camera, antialiased=antialiased, sh_degree=sh_degree)
    close(drawn.rgb, rgb, 2e-3)
    close(1 - drawn.transmittance, alpha, 2e-3)
    r = torch.Generator().manual_seed(3)
    by_rgb, by_alpha = torch.randn(rgb.shape, generator=r), torch.randn(alpha.shape, generator=r)
    torch.autograd.backward([rgb, alpha], [by_rgb, by_alpha])
    torch.autograd.backward([drawn.rgb, drawn.transmittance], [by_rgb, -by_alpha])
    for name, a, b in zip(("means", "log_scales", "quats", "opacity_logits", "sh"), ours, theirs, strict=True):
        assert a.grad is not None and b.grad is not None
        off = (a.grad - b.grad).norm() / a.grad.norm()
        assert off < 0.02, (name, float(off))
    found, expected = drawn.statistics().numpy(), statistics.sums
    seen = expected[:, 1] > 0
    assert seen.sum() > 20
    # gsplat's box around a splat is wider: some more count as drawn, and have no gradient.
    assert not found[~seen, 0].any() and found[seen, 1].all()
    np.testing.assert_allclose(found[seen, 0], expected[seen, 0], rtol=0.05, atol=0.02 * expected[:, 0].max())
    np.testing.assert_allclose(found[seen, 2], expected[seen, 2], rtol=1e-3)


def close(a: torch.Tensor, b: torch.Tensor, limit: float) -> None:
    assert float((a - b).detach().square().mean().sqrt()) < limit
