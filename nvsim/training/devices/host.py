"""The Gaussians under training as numpy arrays, drawn by the numba kernels.

The kernels are called directly instead of through torch's tape. Only the networks need the tape, and this way a step
has no cost besides its kernels.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.workspace import NO_TINT, RenderBuffers
from nvsim.splats.types import Gaussians
from nvsim.training.config import RateConfig
from nvsim.training.devices.types import FEATURES, FIELDS, Float32, Stopwatch, new_rows, rates_of
from nvsim.training.networks import Networks
from nvsim.training.optimizer import ParameterGroup
from nvsim.training.strategies.types import Refinement


class HostGaussianState:
    """A `types.GaussianState` on the CPU. The arrays of `gaussians` are kept, not copied."""

    def __init__(self, gaussians: Gaussians, networks: Networks | None, rate: RateConfig) -> None:
        sh_count = gaussians.sh.shape[1]
        self.groups = {
            name: ParameterGroup.of(getattr(gaussians, name), rates_of(name, rate, sh_count)) for name in FIELDS
        }
        self._networks = networks
        self._colors = None if networks is None else networks.colors
        if self._colors is not None:
            self.groups[FEATURES] = ParameterGroup.of(self._colors.first_features(gaussians), rate.features)
        self.sums = np.zeros((len(gaussians), 3), np.float32)
        self._no_depth = np.zeros((0, 0), np.float32)
        self._tint = NO_TINT
        self._workspace = RenderBuffers()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.groups)

    @property
    def gaussians(self) -> Gaussians:
        """The live arrays."""
        return Gaussians(*(self.groups[name].values for name in FIELDS))

    @property
    def gradients(self) -> Gaussians:
        return Gaussians(*(self.groups[name].gradient for name in FIELDS))

    @property
    def features(self) -> Float32 | None:
        """(N, F) features of the colors; None without a color network."""
        return self.groups[FEATURES].values if FEATURES in self.groups else None

    def __len__(self) -> int:
        return len(self.sums)

    def draw(
        self, camera: Camera, sh_degree: int | None, antialiased: bool, watch: Stopwatch
    ) -> tuple[Float32, Float32]:
        """Color (H, W, 3) and transmittance (H, W) of the Gaussians."""
        k, shown = camera.intrinsics, self.gaussians
        self._tint = NO_TINT
        if self._networks is not None and self._colors is not None:
            features = self.groups[FEATURES].values
            shown, self._tint = self._colors.shown(shown, features, self._networks.seen, camera)
        watch.record_lap("appearance")
        self._workspace.project(shown, camera, antialiased, sh_degree, tint=self._tint)
        watch.record_lap("project")
        self._workspace.bin()
        watch.record_lap("sort")
        rgb, transmittance, _, _ = self._workspace.draw(k.height, k.width, False)
        watch.record_lap("raster")
        return rgb, transmittance

    def differentiate(self, transmittance: Float32, d_rgb: Float32, d_alpha: Float32, watch: Stopwatch) -> None:
        """Propagates the gradients `d_rgb` (H, W, 3) and `d_alpha` (H, W); `transmittance` is (H, W)."""
        if self._no_depth.shape != transmittance.shape:
            self._no_depth = np.zeros(transmittance.shape, np.float32)
        self._workspace.draw_gradient(transmittance, d_rgb, d_alpha, self._no_depth)
        watch.record_lap("raster_backward")
        tint = self._tint
        d_features = tint[0] if len(tint[0]) == 0 else self.groups[FEATURES].gradient
        d_matrix = self._workspace.project_gradient(self.gaussians, self.gradients, self.sums, tint, d_features)
        watch.record_lap("project_backward")
        if self._colors is not None:
            self._colors.collect(self.groups["sh"].gradient, d_matrix, self.groups[FEATURES].gradient)
        watch.record_lap("appearance_backward")

    def step(self, count: int, scales: Mapping[str, float]) -> None:
        for name, group in self.groups.items():
            if name == "sh" and self._colors is not None and not self._colors.own:
                continue  # the color network computes them
            group.step(count, scales.get(name, 1.0))

    def refine(self, refinement: Refinement) -> None:
        features = self.features
        for name, group in self.groups.items():
            born = new_rows(name, refinement, features)
            fresh = np.zeros_like(born)
            values = np.concatenate([group.values[refinement.kept], born])
            group.first = np.concatenate([group.first[refinement.kept], fresh])
            group.second = np.concatenate([group.second[refinement.kept], fresh])
            group.values, group.gradient = values, np.empty_like(values)
        self.sums = np.zeros((refinement.count, 3), np.float32)

    def reset_moments(self, name: str) -> None:
        self.groups[name].first[:] = 0
        self.groups[name].second[:] = 0

    def state(self) -> dict[str, NDArray[np.generic]]:
        """The live arrays (N, ...) of all groups, by name, see `types.GaussianState`."""
        arrays: dict[str, NDArray[np.generic]] = {"sums": self.sums}
        for name, group in self.groups.items():
            arrays[f"{name}.values"] = group.values
            arrays[f"{name}.first"], arrays[f"{name}.second"] = group.first, group.second
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[np.generic]]) -> None:
        """Restores the arrays (N, ...) of `state`, see `types.GaussianState`."""

        def read(name: str) -> Float32:
            return np.ascontiguousarray(arrays[name], np.float32)

        self.sums = read("sums")
        for name, group in self.groups.items():
            group.values, group.first, group.second = (read(f"{name}.{p}") for p in ("values", "first", "second"))
            group.gradient = np.empty_like(group.values)

    def figures(self) -> dict[str, int]:
        return {"intersections": self._workspace.intersections, "visible": self._workspace.visible}
