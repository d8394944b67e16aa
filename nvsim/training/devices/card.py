"""The Gaussians under training as tensors on a CUDA GPU, drawn by gsplat.

Parameters, moments, and the work of the color network are on the GPU. Each step transfers the two images with their
gradients, and the weights of the small networks. Strategies get copies, which are written back afterward."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.gsplat_backend import GsplatOutput, rasterize
from nvsim.splats.types import Gaussians
from nvsim.training.appearance import in_view
from nvsim.training.config import RateConfig
from nvsim.training.devices.types import FEATURES, FIELDS, Float32, Stopwatch, new_rows, rates_of
from nvsim.training.networks import Networks
from nvsim.training.optimizer import BETA1, BETA2, EPS
from nvsim.training.strategies.types import Refinement


@dataclass(eq=False)
class CardGroup:
    """Parameters (N, ...) float32 as a leaf of torch's tape, with both moments; `rates` broadcast against a row."""

    values: torch.Tensor
    rates: torch.Tensor
    first: torch.Tensor
    second: torch.Tensor

    @staticmethod
    def of(values: Float32, rates: Float32 | float, device: str) -> CardGroup:
        """A group with zero moments; `values` (N, ...) are copied, `rates` are one for all or one per column."""
        moved = torch.tensor(values, dtype=torch.float32, device=device)
        per_column = torch.tensor(rates, dtype=torch.float32, device=device)
        if per_column.ndim > 0:
            per_column = per_column.view(moved.shape[1:])
        return CardGroup(moved.requires_grad_(), per_column, torch.zeros_like(moved), torch.zeros_like(moved))

    @property
    def gradient(self) -> torch.Tensor:
        """(N, ...) the gradient; zeros if the last view did not reach the group."""
        if self.values.grad is None:
            self.values.grad = torch.zeros_like(self.values)
        return self.values.grad

    @torch.no_grad()
    def step(self, count: int, scale: float = 1.0) -> None:
        """Makes the `count`-th update (from 1) with all rates times `scale`."""
        slope = self.gradient
        self.first.mul_(BETA1).add_(slope, alpha=1 - BETA1)
        self.second.mul_(BETA2).addcmul_(slope, slope, value=1 - BETA2)
        root = self.second.sqrt().mul_((1 - BETA2**count) ** -0.5).add_(EPS)
        self.values.sub_(self.first.div(root).mul_(self.rates * (scale / (1 - BETA1**count))))

    def replace(self, kept: torch.Tensor, born: Float32) -> None:
        """Keeps the rows `kept` (K,) with their moments, and appends the rows `born` (B, ...) with zero moments."""
        joining = torch.tensor(born, device=self.values.device)
        none = torch.zeros_like(joining)
        self.values = torch.cat([self.values.detach()[kept], joining]).requires_grad_()
        self.first, self.second = torch.cat([self.first[kept], none]), torch.cat([self.second[kept], none])


class CardGaussianState:
    """A `types.GaussianState` on a GPU. `device` is a torch name; "cpu" is for tests, with a reference instead of
    gsplat."""

    def __init__(self, gaussians: Gaussians, networks: Networks | None, rate: RateConfig, device: str) -> None:
        self._device, self._networks = device, networks
        self._colors = None if networks is None else networks.colors
        sh_count = gaussians.sh.shape[1]
        self._groups = {
            name: CardGroup.of(getattr(gaussians, name), rates_of(name, rate, sh_count), device) for name in FIELDS
        }
        if self._colors is not None:
            features = self._colors.first_features(gaussians)
            self._groups[FEATURES] = CardGroup.of(features, rate.features, device)
        self._sums = torch.zeros(len(gaussians), 3, device=device)
        self._drawn: GsplatOutput | None = None
        self._rows: torch.Tensor | None = None  # the Gaussians used for the last view; None for all
        self._lent: Gaussians | None = None
        self._lent_gradients: Gaussians | None = None

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._groups)

    @property
    def gaussians(self) -> Gaussians:
        """Copies of the arrays, which are written back before the GPU next reads them."""
        if self._lent is None:
            self._lent = Gaussians(*(_array(self._groups[name].values) for name in FIELDS))
        return self._lent

    @property
    def gradients(self) -> Gaussians:
        """Copies of the gradients, which are written back before the GPU next reads them."""
        if self._lent_gradients is None:
            self._lent_gradients = Gaussians(*(_array(self._groups[name].gradient) for name in FIELDS))
        return self._lent_gradients

    @property
    def features(self) -> Float32 | None:
        """(N, F) features of the colors; None without a color network."""
        return _array(self._groups[FEATURES].values) if FEATURES in self._groups else None

    @property
    def sums(self) -> Float32:
        """(N, 3) statistics, see `strategies.types.GaussianModel`."""
        return _array(self._sums)

    def __len__(self) -> int:
        return len(self._sums)

    def _take_back(self) -> None:
        for lent, kind in ((self._lent, "values"), (self._lent_gradients, "gradient")):
            if lent is not None:
                for name in FIELDS:
                    getattr(self._groups[name], kind).data.copy_(torch.from_numpy(getattr(lent, name)))
        self._lent = self._lent_gradients = None

    def draw(
        self, camera: Camera, sh_degree: int | None, antialiased: bool, watch: Stopwatch
    ) -> tuple[Float32, Float32]:
        """Color (H, W, 3) and transmittance (H, W) of the Gaussians."""
        self._take_back()
        tensors = {name: group.values for name, group in self._groups.items()}
        self._rows = None
        if self._networks is not None and self._colors is not None:
            if not self._colors.own:  # the network is expensive, so it skips Gaussians out of view
                self._rows = in_view(tensors["means"].detach(), tensors["log_scales"].detach(), camera).nonzero()[:, 0]
                tensors = {name: tensor[self._rows] for name, tensor in tensors.items()}
            tensors["sh"] = self._colors.coefficients(tensors["sh"], tensors[FEATURES], self._networks.seen)
        watch.record_lap("appearance")
        drawn = rasterize(
            *(tensors[name] for name in FIELDS), camera=camera, antialiased=antialiased, sh_degree=sh_degree
        )
        self._drawn = drawn
        rgb, transmittance = _array(drawn.rgb), _array(drawn.transmittance)
        watch.record_lap("raster")
        return rgb, transmittance

    def differentiate(self, transmittance: Float32, d_rgb: Float32, d_alpha: Float32, watch: Stopwatch) -> None:
        """Propagates the gradients `d_rgb` (H, W, 3) and `d_alpha` (H, W); `transmittance` is (H, W)."""
        drawn, self._drawn = self._drawn, None
        assert drawn is not None
        for group in self._groups.values():
            group.values.grad = None
        by_rgb = torch.from_numpy(d_rgb).to(self._device)
        torch.autograd.backward([drawn.rgb, drawn.transmittance], [by_rgb, torch.from_numpy(-d_alpha).to(self._device)])
        found = drawn.statistics()
        rows = slice(None) if self._rows is None else self._rows
        self._sums[rows, :2] += found[:, :2]
        self._sums[rows, 2] = torch.maximum(self._sums[rows, 2], found[:, 2])
        watch.record_lap("raster_backward")

    def step(self, count: int, scales: Mapping[str, float]) -> None:
        self._take_back()
        for name, group in self._groups.items():
            if name == "sh" and self._colors is not None and not self._colors.own:
                continue  # the network computes them
            group.step(count, scales.get(name, 1.0))

    def refine(self, refinement: Refinement) -> None:
        self._take_back()
        features = self.features
        kept = torch.from_numpy(np.ascontiguousarray(refinement.kept)).to(self._device)
        for name, group in self._groups.items():
            group.replace(kept, new_rows(name, refinement, features))
        self._sums = torch.zeros(refinement.count, 3, device=self._device)

    def reset_moments(self, name: str) -> None:
        self._groups[name].first.zero_()
        self._groups[name].second.zero_()

    def state(self) -> dict[str, NDArray[np.generic]]:
        """The arrays (N, ...) of all groups, by name, see `types.GaussianState`."""
        self._take_back()
        arrays: dict[str, NDArray[np.generic]] = {"sums": self.sums}
        for name, group in self._groups.items():
            for part in ("values", "first", "second"):
                arrays[f"{name}.{part}"] = _array(getattr(group, part))
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        """Restores the arrays (N, ...) of `state`, see `types.GaussianState`."""

        def read(name: str) -> torch.Tensor:
            return torch.tensor(np.ascontiguousarray(arrays[name], np.float32), device=self._device)

        self._lent = self._lent_gradients = None
        self._sums = read("sums")
        for name, group in self._groups.items():
            group.values = read(f"{name}.values").requires_grad_()
            group.first, group.second = read(f"{name}.first"), read(f"{name}.second")

    def figures(self) -> dict[str, int]:
        return {"visible": int((self._sums[:, 1] > 0).sum())}


def _array(tensor: torch.Tensor) -> Float32:
    """A contiguous copy for kernels that never shares the memory of the tensor, of any shape."""
    return np.array(tensor.detach().cpu().numpy(), np.float32, order="C")
