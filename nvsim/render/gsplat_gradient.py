"""The rasterizer of gsplat as a differentiable torch function, with the interface of `nvsim.render.autograd`.

The tensors stay on their device, usually a CUDA GPU. A test compares its inputs to gsplat, and the values that it reads
from the backward pass, with the numba kernels on a CPU. There, gsplat's own torch reference replaces its kernels
(tests/unit/test_render_gsplat_gradient.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from nvsim.geometry.camera import Camera
from nvsim.render.gsplat_backend import FAR
from nvsim.render.packed_camera import EPS2D, NEAR

SIGMAS = 3.0
"""Standard deviations of a splat's radius in the statistics, as in the kernels."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """rgb            (H, W, 3) not clamped
    transmittance  (H, W), 1 - alpha

    Both are differentiable in the tensors of the Gaussians.
    """

    rgb: torch.Tensor
    transmittance: torch.Tensor
    _means2d: torch.Tensor  # (1, N, 2) pixels; gsplat stores its absolute gradient in its attribute `absgrad`
    _radii: torch.Tensor  # (1, N, 2) pixels, 0 for Gaussians that are not drawn
    _conics: torch.Tensor  # (1, N, 3) upper triangle of the inverse covariance on the screen

    def statistics(self) -> torch.Tensor:
        """(N, 3) float32 statistics of this view, after its backward pass. The first two columns are added to those of
        `autograd.Statistics.sums`; the third is compared with its third column."""
        height, width = self.transmittance.shape
        longer = float(max(height, width))
        seen = (self._radii[0] > 0).all(dim=-1)
        shift = 0.5 * longer * self._means2d.absgrad[0].norm(dim=-1)  # type: ignore[attr-defined]
        a, b, c = self._conics[0].detach().unbind(-1)
        # The widest direction on the screen is that of the smallest eigenvalue of the inverse covariance.
        least = 0.5 * (a + c) - (0.25 * (a - c).square() + b.square()).sqrt()
        radius = SIGMAS / longer * least.clamp(min=1e-12).rsqrt()
        nothing = torch.zeros_like(radius)
        return torch.stack(
            [torch.where(seen, shift, nothing), seen.to(radius.dtype), torch.where(seen, radius, nothing)], dim=1
        )


def rasterize(
    means: torch.Tensor,  # (N, 3) meters, world
    log_scales: torch.Tensor,  # (N, 3) natural logarithm of the standard deviations in meters
    quats: torch.Tensor,  # (N, 4) w x y z, of any length
    opacity_logits: torch.Tensor,  # (N,)
    sh: torch.Tensor,  # (N, K, 3) coefficients of the color, K = (degree + 1)^2
    *,
    camera: Camera,
    antialiased: bool = True,
    sh_degree: int | None = None,
) -> Drawn:
    """Draws Gaussians; differentiable in all five tensors, float32 on one device: `means` (N, 3) and so on, see the
    signature. `sh_degree` limits the degree of the coefficients that are evaluated; the rest get zero gradients."""
    import gsplat

    k, device = camera.intrinsics, means.device
    degree = round(sh.shape[1] ** 0.5) - 1
    degree = degree if sh_degree is None else min(degree, sh_degree)
    toward = means - torch.tensor(camera.position, dtype=torch.float32, device=device)
    drawn, alphas, info = gsplat.rasterization(
        means=means,
        quats=quats,
        scales=log_scales.exp(),
        opacities=opacity_logits.sigmoid(),
        colors=(gsplat.spherical_harmonics(degree, toward, sh) + 0.5).clamp(min=0.0),
        viewmats=torch.tensor(camera.world_to_camera, dtype=torch.float32, device=device)[None],
        Ks=torch.tensor([[[k.fx, 0, k.cx], [0, k.fy, k.cy], [0, 0, 1]]], dtype=torch.float32, device=device),
        width=k.width,
        height=k.height,
        near_plane=NEAR,
        far_plane=FAR,
        eps2d=EPS2D,
        sh_degree=None,
        packed=False,  # so that the returned info has a row for each Gaussian
        absgrad=torch.is_grad_enabled(),
        render_mode="RGB",
        rasterize_mode="antialiased" if antialiased else "classic",
    )
    return Drawn(drawn[0], 1 - alphas[0, ..., 0], info["means2d"], info["radii"], info["conics"])
