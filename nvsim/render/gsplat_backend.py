"""The rasterizer of gsplat on a CUDA GPU, with the interface of the numba kernels, also differentiable; needs the
extra `gpu`.

Its images agree with those of the numba kernels to 70 dB or better (on an NVIDIA H200 with gsplat 1.5.3), and its
gradients within 0.4 %; tests/benchmarks/on_a_card.py measures both. Two constants of gsplat differ. Alpha is capped
at 0.999, not 0.99. A single pixel stops at transmittance 1e-4; in the kernels a whole tile stops.

The tensors stay on their device, usually a CUDA GPU. A test compares its inputs to gsplat, and the values that it
reads from the backward pass, with the numba kernels on a CPU. There, gsplat's own torch reference replaces its
kernels (tests/unit/test_render_gsplat_gradient.py).
"""

from __future__ import annotations

import threading
import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from nvsim.geometry.camera import Camera
from nvsim.render.backends import Float32, RenderOutput, expected_depth
from nvsim.render.kernel_types import EPS2D, NEAR
from nvsim.splats.types import Gaussians

FAR = 1e6  # meters, as in the kernels


@dataclass(frozen=True, eq=False)
class DeviceGaussians:
    """Gaussians on the GPU, activated as gsplat expects; all float32.

    means      (N, 3) meters, world
    quats      (N, 4) w x y z
    scales     (N, 3) meters
    opacities  (N,)
    sh         (N, K, 3)
    normals    (N, 3) the shortest axes, of either sign
    """

    means: torch.Tensor
    quats: torch.Tensor
    scales: torch.Tensor
    opacities: torch.Tensor
    sh: torch.Tensor
    normals: torch.Tensor


_lock = threading.Lock()
_uploaded: weakref.WeakKeyDictionary[Gaussians, DeviceGaussians] = weakref.WeakKeyDictionary()


def render_over(
    gaussians: Gaussians,
    camera: Camera,
    channels: frozenset[str],
    antialiased: bool,
    lasting: bool = False,
    device: str = "cuda",
) -> tuple[RenderOutput, Float32]:
    """As gaussians.render_over: the requested channels, and the transmittance (H, W).

    lasting   the arrays never change, so that they stay on the GPU as long as `gaussians` exists
    """
    with _lock, torch.no_grad():
        g = _uploaded.get(gaussians) if lasting else None
        if g is None:
            g = upload(gaussians, device)
            if lasting:
                _uploaded[gaussians] = g
        return _render(g, camera, channels, antialiased)


def upload(gaussians: Gaussians, device: str) -> DeviceGaussians:
    """Copies Gaussians to the device. Those that are not finite become transparent; the kernels skip them. Without
    Gaussians, the kernels of gsplat end the process, so one that is transparent takes their place."""
    if not len(gaussians.means):
        gaussians = _invisible(gaussians.sh.shape[1])
    arrays = (gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits, gaussians.sh)
    means, quats, log_scales, logits, sh = (torch.from_numpy(np.ascontiguousarray(a)).to(device) for a in arrays)
    finite = torch.isfinite(torch.cat([means, quats, log_scales, logits[:, None]], dim=1)).all(dim=1)
    quats = torch.where(finite[:, None] & (quats.square().sum(1, keepdim=True) > 1e-20), quats, _UNTURNED.to(device))
    return DeviceGaussians(
        torch.where(finite[:, None], means, 0.0),
        quats,
        torch.where(finite[:, None], log_scales, 0.0).exp(),
        torch.where(finite, logits.sigmoid(), 0.0),
        sh,
        _shortest_axes(quats, log_scales),
    )


def _invisible(coefficients: int) -> Gaussians:
    """One Gaussian without opacity, with this number of coefficients per color."""
    return Gaussians(
        np.zeros((1, 3), np.float32),
        np.zeros((1, 3), np.float32),
        np.array([[1, 0, 0, 0]], np.float32),
        np.full(1, -100, np.float32),
        np.zeros((1, coefficients, 3), np.float32),
    )


_UNTURNED = torch.tensor([1.0, 0.0, 0.0, 0.0])


def _render(
    g: DeviceGaussians, camera: Camera, channels: frozenset[str], antialiased: bool
) -> tuple[RenderOutput, Float32]:
    import gsplat

    device = g.means.device
    eye = torch.tensor(camera.position, dtype=torch.float32, device=device)
    toward = g.means - eye
    # Colors and normals in one pass: gsplat accepts any number of channels beside the depth.
    features = []
    if "rgb" in channels:
        degree = round(g.sh.shape[1] ** 0.5) - 1
        features.append((gsplat.spherical_harmonics(degree, toward, g.sh) + 0.5).clamp(min=0.0))
    if "normal" in channels:
        away = (g.normals * toward).sum(dim=1, keepdim=True) > 0
        features.append(torch.where(away, -g.normals, g.normals))
    colors = torch.cat(features, dim=1) if features else torch.zeros(len(g.means), 1, device=device)
    drawn, alphas, _ = gsplat.rasterization(
        means=g.means,
        quats=g.quats,
        scales=g.scales,
        opacities=g.opacities,
        colors=colors,
        **_view_arguments(camera, antialiased, device),
        render_mode="RGB+D" if "depth" in channels else "RGB",
    )
    image = drawn[0].cpu().numpy()
    alpha = np.ascontiguousarray(alphas[0, ..., 0].cpu().numpy())
    output = RenderOutput()
    if "rgb" in channels:
        output.rgb = np.ascontiguousarray(image[..., :3])
    if "normal" in channels:
        first = 3 if "rgb" in channels else 0
        output.normal = np.ascontiguousarray(image[..., first : first + 3])
    if "depth" in channels:
        output.depth = expected_depth(image[..., -1], alpha)
    if "alpha" in channels:
        output.alpha = alpha
    return output, 1 - alpha


def _view_arguments(camera: Camera, antialiased: bool, device: torch.device) -> dict[str, Any]:
    """The arguments of `gsplat.rasterization` that define the view."""
    k = camera.intrinsics
    return {
        "viewmats": torch.tensor(camera.world_to_camera, dtype=torch.float32, device=device)[None],
        # gsplat samples pixels at their centers, half a pixel from their corner, like our cameras.
        "Ks": torch.tensor([[[k.fx, 0, k.cx], [0, k.fy, k.cy], [0, 0, 1]]], dtype=torch.float32, device=device),
        "width": k.width,
        "height": k.height,
        "near_plane": NEAR,
        "far_plane": FAR,
        "eps2d": EPS2D,
        "sh_degree": None,
        "rasterize_mode": "antialiased" if antialiased else "classic",
    }


def _shortest_axes(quats: torch.Tensor, log_scales: torch.Tensor) -> torch.Tensor:
    """(N, 3) the column of the rotation for the smallest scale, the first of equal ones."""
    w, x, y, z = torch.nn.functional.normalize(quats, dim=1).unbind(1)
    axes = (
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], dim=1),
        torch.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], dim=1),
        torch.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], dim=1),
    )
    a, b, c = log_scales.unbind(1)
    first, second = ((a <= b) & (a <= c))[:, None], (b <= c)[:, None]
    return torch.where(first, axes[0], torch.where(second, axes[1], axes[2]))


SIGMAS = 3.0
"""Standard deviations of a splat's radius in the statistics, as in the kernels."""


@dataclass(frozen=True, eq=False)
class GsplatOutput:
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
) -> GsplatOutput:
    """Draws Gaussians; differentiable in all five tensors, float32 on one device: `means` (N, 3) and so on, see the
    signature. `sh_degree` limits the degree of the coefficients that are evaluated; the rest get zero gradients."""
    import gsplat

    device = means.device
    degree = round(sh.shape[1] ** 0.5) - 1
    degree = degree if sh_degree is None else min(degree, sh_degree)
    toward = means - torch.tensor(camera.position, dtype=torch.float32, device=device)
    drawn, alphas, info = gsplat.rasterization(
        means=means,
        quats=quats,
        scales=log_scales.exp(),
        opacities=opacity_logits.sigmoid(),
        colors=(gsplat.spherical_harmonics(degree, toward, sh) + 0.5).clamp(min=0.0),
        **_view_arguments(camera, antialiased, device),
        packed=False,  # so that the returned info has a row for each Gaussian
        absgrad=torch.is_grad_enabled(),
        render_mode="RGB",
    )
    return GsplatOutput(drawn[0], 1 - alphas[0, ..., 0], info["means2d"], info["radii"], info["conics"])
