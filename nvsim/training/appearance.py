"""Training of colors that depend on the embedding (see `nvsim.splats.appearance`).

`shown` gives the Gaussians with the colors of a view. `collect` takes the gradients of their coefficients and of the
tint matrix, and fills the gradients of the features, the weights, and the embedding.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.kernels import njit, prange
from nvsim.render.sky import pack_camera
from nvsim.render.workspace import NO_TINT, Tint
from nvsim.splats.appearance import LinearAppearance, NetworkAppearance
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Embedding, Gaussians
from nvsim.training.config import AppearanceConfig
from nvsim.training.optimizer import Parameters, propagate_gradient, random_generator

_F = np.float32
_REACH = _F(3.4)  # standard deviations beyond which a Gaussian draws nothing
_FILTER = _F(2.0)  # pixels added to the radius of a Gaussian by the low-pass filter of a pixel
COLOR = 3
"""Number of features of the linear form that start as the color."""
Float32 = NDArray[np.float32]


@njit(parallel=True, cache=True, nogil=True)
def mark_in_view(
    means: Float32,  # (N, 3) meters, world
    log_scales: Float32,  # (N, 3) logarithms of meters
    camera: Float32,  # (16,) `pack_camera`
    size: Float32,  # (2,) width and height, pixels
    seen: NDArray[np.bool_],  # (N,) out
) -> None:
    """Sets `seen` (N,) for the Gaussians that a view can draw. Some others are set too, but none is missing."""
    steepest = max(camera[14], size[0] - camera[14]) / camera[12], max(camera[15], size[1] - camera[15]) / camera[13]
    # The affine approximation enlarges a Gaussian at most by this factor.
    stretch = np.sqrt(_F(1) + _F(1.7) * max(steepest[0], steepest[1]) ** 2)
    for g in prange(len(means)):
        dx, dy, dz = means[g, 0] - camera[9], means[g, 1] - camera[10], means[g, 2] - camera[11]
        depth = camera[2] * dx + camera[5] * dy + camera[8] * dz
        seen[g] = False
        if depth > _F(0.04):
            widest = max(log_scales[g, 0], max(log_scales[g, 1], log_scales[g, 2]))
            reach = _REACH * np.exp(min(widest, _F(10))) * stretch / depth
            u = (camera[0] * dx + camera[3] * dy + camera[6] * dz) / depth * camera[12] + camera[14]
            v = (camera[1] * dx + camera[4] * dy + camera[7] * dz) / depth * camera[13] + camera[15]
            wide, high = reach * camera[12] + _FILTER, reach * camera[13] + _FILTER
            seen[g] = u > -wide and u < size[0] + wide and v > -high and v < size[1] + high


def in_view(means: torch.Tensor, log_scales: torch.Tensor, camera: Camera) -> torch.Tensor:
    """(N,) bool as in `mark_in_view`, for tensors `means` (N, 3) meters, world, and `log_scales` (N, 3) on any
    device."""
    k = camera.intrinsics
    rotation = torch.tensor(camera.rotation, dtype=torch.float32, device=means.device)
    eye = torch.tensor(camera.position, dtype=torch.float32, device=means.device)
    x, y, depth = ((means - eye) @ rotation).unbind(1)
    steepest = max(max(k.cx, k.width - k.cx) / k.fx, max(k.cy, k.height - k.cy) / k.fy)
    stretch = (1 + 1.7 * steepest**2) ** 0.5
    reach = float(_REACH) * stretch * log_scales.amax(dim=1).clamp(max=10).exp() / depth
    u, v = x / depth * k.fx + k.cx, y / depth * k.fy + k.cy
    wide, high = reach * k.fx + float(_FILTER), reach * k.fy + float(_FILTER)
    return (depth > 0.04) & (u > -wide) & (u < k.width + wide) & (v > -high) & (v < k.height + high)


class LinearColors:
    """Adds W(embedding) features to SH coefficient 0. Features and the Gaussians' own coefficients are both learned."""

    own = True
    """Whether the Gaussians' own coefficients are used."""

    def first_features(self, gaussians: Gaussians) -> Float32:
        """(N, F) initial features of Gaussians. The first ones are their colors. W starts at zero for them, so that an
        exposure by position is learned for all colors at once. The others are zero; W is random there."""
        features = np.zeros((len(gaussians), self._shape[1]), np.float32)
        features[:, :COLOR] = gaussians.sh[:, 0, : self._shape[1]] + np.float32(0.5 / DC)
        return features

    def __init__(self, config: AppearanceConfig, seed: int) -> None:
        self._shape = (3, config.features)
        self._parameters = Parameters({"matrix": (3 * config.features, config.size)}, random_generator(seed, 2))
        self.values, self.gradient = self._parameters.values, self._parameters.gradient
        with torch.no_grad():
            for kind in ("weight", "bias"):
                rows = self._parameters.tensors[f"matrix.{kind}"].view(3, config.features, -1)
                rows[:, :COLOR] = 0
        self._matrix = torch.zeros(self._shape)

    def shown(
        self, gaussians: Gaussians, features: Float32, embedding: torch.Tensor, camera: Camera
    ) -> tuple[Gaussians, Tint]:
        """The Gaussians as `camera` sees them, and their tint: features (N, F) and matrix (3, F)."""
        self._matrix = self._parameters.linear("matrix", embedding).view(self._shape)
        return gaussians, (features, np.ascontiguousarray(self._matrix.detach().numpy()))

    def coefficients(self, sh: torch.Tensor, features: torch.Tensor, embedding: torch.Tensor) -> torch.Tensor:
        """(V, K, 3) coefficients of Gaussians with their own coefficients `sh` (V, K, 3) and `features` (V, F), on the
        device of these. Differentiable in all three arguments."""
        matrix = self._parameters.linear("matrix", embedding).view(self._shape).to(features.device)
        return torch.cat([sh[:, :1] + (features @ matrix.T)[:, None], sh[:, 1:]], dim=1)

    def collect(self, d_sh: Float32, d_matrix: Float32, d_features: Float32) -> None:
        """Propagates the gradient of the last tint matrix (3, F). The gradient of the features already exists."""
        propagate_gradient(self._matrix, torch.from_numpy(d_matrix))

    def exported(self, embedding: Embedding, features: Float32, middle: NDArray[np.float64]) -> LinearAppearance:
        """A copy without torch. `features` is (N, F), `middle` (3,) the mean camera position, meters."""
        return LinearAppearance(embedding, self._parameters.exported(), features.copy(), middle)


class NetworkColors:
    """Computes all coefficients from (embedding, features) with a network, only for Gaussians in view
    (Splatfacto-W)."""

    own = False

    def first_features(self, gaussians: Gaussians) -> Float32:
        """(N, F) initial features of Gaussians: zeros."""
        return np.zeros((len(gaussians), self._width), np.float32)

    def __init__(self, config: AppearanceConfig, seed: int, sh_count: int) -> None:
        layers, previous = {}, config.size + config.features
        self._depth = config.layers - 1
        for i in range(self._depth):
            layers[f"colour.{i}"] = (config.width, previous)
            previous = config.width
        layers["base"] = (3, previous)
        if sh_count > 1:
            layers["rest"] = (3 * (sh_count - 1), previous)
        self._parameters = Parameters(layers, random_generator(seed, 2), zero=("rest",))
        self.values, self.gradient = self._parameters.values, self._parameters.gradient
        self._size, self._width = config.size, config.features
        self._seen = np.empty(0, np.bool_)
        self._rows = np.empty(0, np.int64)
        self._features = self._sh = torch.zeros(0)

    def shown(
        self, gaussians: Gaussians, features: Float32, embedding: torch.Tensor, camera: Camera
    ) -> tuple[Gaussians, Tint]:
        """The Gaussians as `camera` sees them: the coefficients of those in view are overwritten. `features` is (N,
        F)."""
        k = camera.intrinsics
        if len(self._seen) != len(gaussians):
            self._seen = np.empty(len(gaussians), np.bool_)
        size = np.array([k.width, k.height], np.float32)
        mark_in_view(gaussians.means, gaussians.log_scales, pack_camera(camera), size, self._seen)
        self._rows = np.flatnonzero(self._seen)
        self._features = torch.from_numpy(features[self._rows]).requires_grad_()
        self._sh = self.evaluate(embedding, self._features)
        gaussians.sh[self._rows] = self._sh.detach().numpy().reshape(len(self._rows), -1, 3)
        return gaussians, NO_TINT

    def coefficients(self, sh: torch.Tensor, features: torch.Tensor, embedding: torch.Tensor) -> torch.Tensor:
        """(V, K, 3) as in `LinearColors`; only the shape of `sh` (V, K, 3) is used."""
        return self.evaluate(embedding.to(features.device), features).view(sh.shape)

    def evaluate(self, embedding: torch.Tensor, features: torch.Tensor) -> torch.Tensor:
        """(V, 3 K) coefficients for `features` (V, F)."""
        p, e = self._parameters, self._size
        first = p.tensor_on_device(features, "colour.0.weight")
        # The contribution of the embedding to the first layer is equal for all Gaussians.
        shared = torch.mv(first[:, :e], embedding) + p.tensor_on_device(features, "colour.0.bias")
        h = torch.relu(torch.addmm(shared, features, first[:, e:].T))
        for i in range(1, self._depth):
            h = torch.relu(p.linear(f"colour.{i}", h))
        heads = [p.linear(name, h) for name in ("base", "rest") if f"{name}.weight" in p.tensors]
        return torch.cat(heads, dim=1)

    def collect(self, d_sh: Float32, d_matrix: Float32, d_features: Float32) -> None:
        """Propagates the gradient of the last coefficients, `d_sh` (N, K, 3), and writes `d_features` (N, F)."""
        propagate_gradient(self._sh, torch.from_numpy(d_sh[self._rows].reshape(len(self._rows), -1)))
        d_features[:] = 0
        if self._features.grad is not None:
            d_features[self._rows] = self._features.grad.numpy()

    def exported(self, embedding: Embedding, features: Float32, middle: NDArray[np.float64]) -> NetworkAppearance:
        """A copy without torch. `features` is (N, F), `middle` (3,) the mean camera position, meters."""
        return NetworkAppearance(embedding, self._parameters.exported(), features.copy(), middle)


def baked(appearance: LinearAppearance | NetworkAppearance, gaussians: Gaussians) -> Gaussians:
    """`gaussians` with own coefficients that are exact for the mean camera position. For the color network these are
    its output there; for the linear form the Gaussians are unchanged."""
    if isinstance(appearance, LinearAppearance):
        return gaussians
    exact = replace(appearance, cell=0.0)
    return replace(gaussians, sh=exact.colored(gaussians, appearance.middle).sh.copy())
