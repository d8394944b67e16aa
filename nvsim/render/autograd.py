"""The rasterizer as a differentiable torch function, for CPU tensors only.

Torch and numba each have a thread pool. Set OMP_WAIT_POLICY=PASSIVE in the environment before either is imported. Then
the waiting pool does not take cores from the working one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.workspace import LOCK, RenderBuffers
from nvsim.splats.types import Gaussians

_free: list[RenderBuffers] = []
# Unused buffers. A forward pass takes one and its backward pass returns it, so that several views can wait for their
# gradients at the same time.

_UNTRACKED = np.empty((0, 3), np.float32)


@dataclass(eq=False)
class Statistics:
    """The sums that densification reads, over the backward passes since this object was made.

    sums   (N, 3) float32, per Gaussian, three values: the sum over views of the length of the vector of (sum over
           pixels of |dL/dx|, sum over pixels of |dL/dy|), with the center in units of half the longer image side
           (absolute gradients of gsplat and AbsGS); the number of views that drew it; the largest screen radius (three
           standard deviations) as a share of the longer side
    """

    sums: NDArray[np.float32]

    @staticmethod
    def zeros(count: int) -> Statistics:
        return Statistics(np.zeros((count, 3), np.float32))

    @property
    def gradient(self) -> NDArray[np.float32]:
        """(N,) mean absolute gradient over the views that drew the Gaussian."""
        return np.asarray(self.sums[:, 0] / np.maximum(self.sums[:, 1], 1), np.float32)

    @property
    def count(self) -> NDArray[np.float32]:
        """(N,) number of views that drew the Gaussian."""
        return self.sums[:, 1]

    @property
    def radius(self) -> NDArray[np.float32]:
        """(N,) largest radius as a share of the longer image side."""
        return self.sums[:, 2]


def rasterize(
    means: torch.Tensor,  # (N, 3) meters, world
    log_scales: torch.Tensor,  # (N, 3) natural logarithm of the standard deviations in meters
    quats: torch.Tensor,  # (N, 4) w x y z, of any length
    opacity_logits: torch.Tensor,  # (N,)
    sh: torch.Tensor,  # (N, K, 3) coefficients of the color, K = (degree + 1)^2
    camera: Camera,
    *,
    antialiased: bool = True,
    sh_degree: int | None = None,
    depth: bool = False,
    statistics: Statistics | None = None,
) -> tuple[torch.Tensor, ...]:
    """Draws Gaussians; differentiable in all five tensors, which are float32 on the CPU.

    sh_degree    evaluates the coefficients only up to this degree; the rest get zero gradients
    depth        adds the expected depth, as in RenderOutput, also differentiable
    statistics   is updated during the backward pass

    Returns rgb (H, W, 3), not clamped, and alpha (H, W)[, depth (H, W)], float32. Raises ValueError for tensors of
    another type or device.
    """
    for tensor in (means, log_scales, quats, opacity_logits, sh):
        if tensor.dtype != torch.float32 or tensor.device.type != "cpu":
            raise ValueError(f"rasterize needs float32 tensors on the CPU, got {tensor.dtype} on {tensor.device}")
    if statistics is not None and len(statistics.sums) != len(means):
        raise ValueError(f"statistics of {len(statistics.sums)} Gaussians do not fit {len(means)}")
    result: tuple[torch.Tensor, ...] = Rasterize.apply(
        means, log_scales, quats, opacity_logits, sh, camera, antialiased, sh_degree, depth, statistics
    )
    return result


class Rasterize(torch.autograd.Function):
    """The autograd function of `rasterize`."""

    @staticmethod
    def forward(
        ctx: Any,  # torch stores assigned attributes here, which its type does not declare; in `backward` too
        means: torch.Tensor,
        log_scales: torch.Tensor,
        quats: torch.Tensor,
        opacity_logits: torch.Tensor,
        sh: torch.Tensor,
        camera: Camera,
        antialiased: bool,
        sh_degree: int | None,
        with_depth: bool,
        statistics: Statistics | None,
    ) -> tuple[torch.Tensor, ...]:
        """Draws the Gaussians and keeps the buffers for `backward`. Arguments and shapes are those of `rasterize`."""
        given = (means, log_scales, quats, opacity_logits, sh)
        gaussians = Gaussians(*(t.detach().contiguous().numpy() for t in given))
        k = camera.intrinsics
        with LOCK:
            workspace = _free.pop() if _free else RenderBuffers()
            workspace.project(gaussians, camera, antialiased, sh_degree)
            workspace.bin()
            rgb, transmittance, depth, _ = workspace.draw(k.height, k.width, with_depth)
            if any(ctx.needs_input_grad):
                ctx.workspace = workspace
            else:
                _free.append(workspace)
        alpha = 1 - transmittance
        # save_for_backward notices if a tensor is changed in place before the backward pass.
        ctx.save_for_backward(*given)
        ctx.transmittance, ctx.statistics = transmittance, statistics
        ctx.set_materialize_grads(False)
        if not with_depth:
            return torch.from_numpy(rgb), torch.from_numpy(alpha)
        depth = np.where(alpha < 1e-3, np.float32(0), depth / np.maximum(alpha, 1e-3))
        ctx.depth, ctx.alpha = depth, alpha
        return torch.from_numpy(rgb), torch.from_numpy(alpha), torch.from_numpy(depth)

    @staticmethod
    def backward(
        ctx: Any,
        *outputs: torch.Tensor | None,  # gradients by rgb (H, W, 3), alpha (H, W), and depth (H, W) if it was drawn
    ) -> tuple[torch.Tensor | None, ...]:
        """Returns the gradients of the five tensors, of equal shape. Raises RuntimeError on a second call."""
        if ctx.workspace is None:
            raise RuntimeError("the gradient of rasterize can be computed only once per forward pass")
        shape = ctx.transmittance.shape
        d_rgb, d_alpha = _image(outputs[0], (*shape, 3)), _image(outputs[1], shape)
        d_depth = _image(outputs[2] if len(outputs) > 2 else None, shape)
        if len(outputs) > 2 and outputs[2] is not None:
            # depth = sum / alpha, and zero if alpha is almost zero
            d_depth = np.where(ctx.alpha < 1e-3, np.float32(0), d_depth / np.maximum(ctx.alpha, 1e-3))
            d_alpha = d_alpha - d_depth * ctx.depth
        tensors = [t.detach().contiguous() for t in ctx.saved_tensors]
        d_tensors = [torch.empty_like(t) for t in tensors]
        statistics = _UNTRACKED if ctx.statistics is None else ctx.statistics.sums
        with LOCK:
            workspace: RenderBuffers = ctx.workspace
            workspace.draw_gradient(ctx.transmittance, d_rgb, d_alpha, d_depth)
            workspace.project_gradient(
                Gaussians(*(t.numpy() for t in tensors)), Gaussians(*(t.numpy() for t in d_tensors)), statistics
            )
            ctx.workspace = None
            _free.append(workspace)
        return (*d_tensors, None, None, None, None, None)


def _image(gradient: torch.Tensor | None, shape: tuple[int, ...]) -> NDArray[np.float32]:
    if gradient is None:
        return np.zeros(shape, np.float32)
    return gradient.detach().contiguous().numpy()
