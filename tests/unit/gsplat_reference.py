"""gsplat on a CPU: its own torch reference of projection and harmonics, composited plainly, in place of its kernels."""

from __future__ import annotations

import importlib.util
import inspect
from typing import Any

import pytest
import torch

INSTALLED = importlib.util.find_spec("gsplat") is not None


def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """Puts the reference where gsplat's kernels are; calls that gsplat would not take are errors."""
    import gsplat
    from gsplat.cuda import _torch_impl as impl

    signature = inspect.signature(gsplat.rasterization)

    def rasterization(**given: Any) -> tuple[torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        signature.bind(**given)
        return _rasterization(**given)

    monkeypatch.setattr(gsplat, "rasterization", rasterization)
    monkeypatch.setattr(gsplat, "spherical_harmonics", impl._spherical_harmonics)


def _rasterization(**given: Any) -> tuple[torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
    # One camera; differentiable, with the absolute gradient of the centers where it is asked for.
    from gsplat.cuda import _torch_impl as impl

    width, height = given["width"], given["height"]
    covariances, _ = impl._quat_scale_to_covar_preci(given["quats"], given["scales"], compute_preci=False)
    radii, centers, depths, conics, compensations = impl._fully_fused_projection(
        given["means"],
        covariances,
        given["viewmats"],
        given["Ks"],
        width,
        height,
        eps2d=given["eps2d"],
        near_plane=given["near_plane"],
        far_plane=given["far_plane"],
        calc_compensations=given["rasterize_mode"] == "antialiased",
    )
    opacities = given["opacities"] if compensations is None else given["opacities"] * compensations[0]
    colors = given["colors"]
    if given["render_mode"] == "RGB+D":
        colors = torch.cat([colors, depths[0, :, None]], dim=1)
    order = torch.argsort(depths[0])
    order = order[(radii[0] > 0).all(dim=1)[order]]
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    # Each pixel has its own copy of the centers, so that what comes back to a copy is the gradient from one pixel.
    spread = centers[0][order, None].expand(-1, height * width, -1).clone()
    if given.get("absgrad"):

        def keep(gradient: torch.Tensor) -> None:
            centers.absgrad = torch.zeros_like(centers)
            centers.absgrad[0, order] = gradient.abs().sum(dim=1)

        centers.absgrad = torch.zeros_like(centers)
        if spread.requires_grad:
            spread.register_hook(keep)
    dx, dy = x.reshape(-1) - spread[..., 0], y.reshape(-1) - spread[..., 1]
    a, b, c = (part[:, None] for part in conics[0][order].unbind(1))
    alpha = opacities[order, None] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)
    alpha = torch.where(alpha < 1 / 255, 0.0, alpha.clamp(max=0.999))
    through = torch.cumprod(torch.cat([torch.ones(1, height * width), 1 - alpha]), dim=0)
    image = torch.einsum("np,nc->pc", alpha * through[:-1], colors[order]).view(1, height, width, -1)
    info = {"means2d": centers, "radii": radii, "conics": conics}
    return image, (1 - through[-1]).view(1, height, width, 1), info
