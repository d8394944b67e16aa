"""One model in the making: draw a view, take the loss, send its gradient back, move every parameter.

The rasteriser's kernels are driven by hand instead of through torch's tape: only the networks need one, and
a step costs what its kernels cost.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.floor_texture import pack_floor
from nvsim.render.workspace import LOCK, NO_TINT, RenderBuffers, Tint
from nvsim.splats.types import Gaussians, SubmapModel
from nvsim.training.background.floor_rays import meet_floor
from nvsim.training.background.harmonics import evaluate, evaluate_gradient, pack_camera
from nvsim.training.background.texture import LearnedTexture
from nvsim.training.config import RateConfig, TrainingConfig
from nvsim.training.exposure import Exposure
from nvsim.training.loss.alpha import alpha_loss
from nvsim.training.loss.floor_aware import LossValues
from nvsim.training.networks import Networks
from nvsim.training.optimizer import Group
from nvsim.training.stopwatch import Stopwatch
from nvsim.training.strategies.types import Refinement
from nvsim.training.view_buffers import ViewBuffers
from nvsim.training.views import TrainingView

Float32 = NDArray[np.float32]
TEXTURE_STEPS = 4
"""Steps whose gradients the texture gathers before it moves: a view touches few of its many texels."""
FIELDS = ("means", "log_scales", "quats", "opacity_logits", "sh")
FEATURES = "features"
"""The group of what the networks colour Gaussians from, a row per Gaussian as in those of FIELDS."""


STEP_PARTS = (
    "appearance",
    "project",
    "sort",
    "raster",
    "background",
    "loss",
    "raster_backward",
    "project_backward",
    "appearance_backward",
    "background_backward",
    "optimizer",
)
"""What a step is made of, in order."""


def rates_of(name: str, rate: RateConfig, sh_count: int) -> Float32 | float:
    """The learning rate of a group of Gaussian parameters, per column where columns differ."""
    if name == "sh":
        return np.array([rate.sh_dc] * 3 + [rate.sh_rest] * (3 * sh_count - 3), np.float32)
    return float(getattr(rate, name))


class Fit:
    """Parameters, their moments and what densification counts. `parts` are the milliseconds of the last step."""

    def __init__(
        self,
        gaussians: Gaussians,
        networks: Networks | None,
        texture: LearnedTexture | None,
        floor: FloorSurface,
        config: TrainingConfig,
        views: int = 1,
    ) -> None:
        self.config, self.floor = config, floor
        self.exposure = Exposure(views, config.rate.exposure) if config.exposure else None
        self.networks, self.texture = networks, texture
        self.sums = np.zeros((len(gaussians), 3), np.float32)
        self.parts: dict[str, float] = {}
        sh_count = gaussians.sh.shape[1]
        self.groups = {
            name: Group.of(getattr(gaussians, name), rates_of(name, config.rate, sh_count)) for name in FIELDS
        }
        self.per_gaussian: tuple[str, ...] = FIELDS
        self._painter = self._colours = None
        if networks is not None:
            self.groups |= networks.groups()
            self._painter, self._colours = networks.background, networks.colours
        if networks is not None and networks.colours is not None:
            self.groups[FEATURES] = Group.of(networks.colours.first_features(gaussians), config.rate.features)
            self.per_gaussian = (*FIELDS, FEATURES)
        if texture is not None:
            self.groups["texture"] = Group.of(texture.values, config.rate.texture, texture.gradient)
        self.workspace = RenderBuffers()
        self._canvases: dict[tuple[int, int], ViewBuffers] = {}
        self._heights, self._grid = pack_floor(floor)
        self._share = 0.0
        self._tint = NO_TINT
        self._watch = Stopwatch()

    @property
    def gaussians(self) -> Gaussians:
        """The live arrays."""
        return Gaussians(*(self.groups[name].values for name in FIELDS))

    @property
    def gradients(self) -> Gaussians:
        return Gaussians(*(self.groups[name].gradient for name in FIELDS))

    def canvas(self, width: int, height: int) -> ViewBuffers:
        key = (width, height)
        if key not in self._canvases:
            self._canvases[key] = ViewBuffers.of(self.config.loss, width, height)
        return self._canvases[key]

    def paint(self, camera: Camera, transmittance: Float32, floor: NDArray[np.bool_] | None = None) -> Float32:
        """(3, H, W) the background of the view last looked at, in a buffer that the next view of this size overwrites.
        The texture lies only where light comes through, transmittance (H, W), and in the pixels of `floor` (H, W)."""
        canvas = self.canvas(camera.intrinsics.width, camera.intrinsics.height)
        if self.networks is None or self._painter is None:
            return canvas.background
        evaluate(camera, self.networks.backdrop(self._share), canvas.background)
        if self.texture is not None:
            wanted = canvas.nowhere if floor is None else floor
            meet_floor(pack_camera(camera), self._heights, self._grid, wanted, transmittance, canvas.hits)
            self.texture.add(canvas.hits, canvas.background)
        return canvas.background

    def look(self, camera: Camera, name: str | None = None) -> None:
        """Begins a view: that of the training image `name`, or of none."""
        if self.networks is not None:
            self.networks.look(camera.position, name)

    def draw(self, camera: Camera, sh_degree: int | None = None) -> tuple[Float32, Float32]:
        """Colour of the Gaussians (H, W, 3) and transmittance (H, W) of the view last looked at."""
        k = camera.intrinsics
        shown, self._tint = self._shown(camera)
        self._watch.lap("appearance")
        self.workspace.project(shown, camera, self.config.antialiased, sh_degree, tint=self._tint)
        self._watch.lap("project")
        self.workspace.bin()
        self._watch.lap("sort")
        rgb, transmittance, _, _ = self.workspace.draw(k.height, k.width, False)
        self._watch.lap("raster")
        return rgb, transmittance

    def _shown(self, camera: Camera) -> tuple[Gaussians, Tint]:
        if self.networks is None or self._colours is None:
            return self.gaussians, NO_TINT
        return self._colours.shown(self.gaussians, self.groups[FEATURES].values, self.networks.seen, camera)

    def composite(self, camera: Camera) -> tuple[Float32, Float32]:
        """The image (H, W, 3), not clamped, and alpha (H, W)."""
        with LOCK:
            self.look(camera)
            rgb, transmittance = self.draw(camera)
            background = self.paint(camera, transmittance)
        return rgb + transmittance[..., None] * background.transpose(1, 2, 0), 1 - transmittance

    def differentiate(
        self,
        view: TrainingView,
        inlier: NDArray[np.bool_],
        sh_degree: int,
        index: int = 0,
        judge: Callable[[Float32, Float32, Float32], None] | None = None,
    ) -> LossValues:
        """Draws view `index` and fills every group's gradient. The error of each pixel is in the canvas's loss. `judge`
        may change `inlier` when it has seen the colour of the Gaussians, the transmittance and the background."""
        camera = view.camera
        canvas = self.canvas(camera.intrinsics.width, camera.intrinsics.height)
        watch = self._watch = Stopwatch()
        with LOCK:
            self.look(camera, view.name)
            rgb, transmittance = self.draw(camera, sh_degree)
            background = self.paint(camera, transmittance, view.floor)
            watch.lap("background")
            loss = canvas.loss
            if self.exposure is not None:
                self.exposure.apply(index, rgb, background)
            if judge is not None:
                judge(rgb, transmittance, background)
            values = loss(rgb, transmittance, background, view.image, view.floor, inlier, view.doubtful)
            if self.config.loss.alpha > 0:
                more = alpha_loss(1 - transmittance, background, view.image, self.config.loss.alpha, loss.d_alpha)
                values = replace(values, total=values.total + more)
            if self.exposure is not None:
                self.exposure.learn(index, rgb, background, loss.d_rgb, loss.d_background)
            watch.lap("loss")
            self.workspace.draw_gradient(transmittance, loss.d_rgb, loss.d_alpha, canvas.no_depth)
            watch.lap("raster_backward")
            tint = self._tint
            d_features = tint[0] if len(tint[0]) == 0 else self.groups[FEATURES].gradient
            d_matrix = self.workspace.project_gradient(self.gaussians, self.gradients, self.sums, tint, d_features)
            watch.lap("project_backward")
            if self._colours is not None:
                self._colours.collect(self.groups["sh"].gradient, d_matrix, self.groups[FEATURES].gradient)
            watch.lap("appearance_backward")
            if self.networks is not None and self._painter is not None:
                self.networks.backdrop_gradient(evaluate_gradient(camera, loss.d_background, canvas.rows))
            if self.networks is not None:
                self.networks.learn()
            if self.texture is not None and self.config.loss.floor > 0:
                self.texture.collect(canvas.hits, view.floor, loss.d_background)
            watch.lap("background_backward")
        self.parts = watch.laps
        return values

    def move(self, step: int) -> None:
        """Update number `step` (from 1) of every parameter."""
        started = time.perf_counter()
        share, rate = (step - 1) / self.config.steps, self.config.rate
        self._share = step / self.config.steps
        decay = {
            "means": rate.means_end / rate.means,
            **dict.fromkeys(("embedding", "network", "colours"), rate.network_end / rate.network),
            FEATURES: rate.features_end / rate.features,
            "texture": rate.texture_end / rate.texture,
        }
        with LOCK:
            for name, group in self.groups.items():
                if name == "sh" and self._colours is not None and not self._colours.own:
                    continue  # they are what the colour network made last
                if name != "texture":
                    group.step(step, decay.get(name, 1.0) ** share)
                elif step % TEXTURE_STEPS == 0:
                    group.step(step // TEXTURE_STEPS, decay[name] ** share)
                    group.gradient[:] = 0
        self.parts["optimizer"] = 1e3 * (time.perf_counter() - started)

    def refine(self, refinement: Refinement) -> None:
        """Replaces the Gaussians; the survivors keep their moments, the new ones start with none."""
        for name in self.per_gaussian:
            group = self.groups[name]
            born = group.values[refinement.parents] if name == FEATURES else getattr(refinement.born, name)
            fresh = np.zeros_like(born)
            values = np.concatenate([group.values[refinement.kept], born])
            group.first = np.concatenate([group.first[refinement.kept], fresh])
            group.second = np.concatenate([group.second[refinement.kept], fresh])
            group.values, group.gradient = values, np.empty_like(values)
        self.sums = np.zeros((refinement.count, 3), np.float32)

    def forget(self, name: str) -> None:
        """Clears both moments of a group."""
        self.groups[name].first[:] = 0
        self.groups[name].second[:] = 0

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Everything that a step changes, by name."""
        arrays: dict[str, NDArray[np.generic]] = {"sums": self.sums, "share": np.array(self._share)}
        for name, group in self.groups.items():
            arrays[f"{name}.values"] = group.values
            arrays[f"{name}.first"], arrays[f"{name}.second"] = group.first, group.second
        if self.texture is not None:
            arrays["texture.gradient"] = self.texture.gradient
        return arrays if self.exposure is None else {**arrays, **self.exposure.state()}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """The inverse of `state`, in a fit of the same configuration and views."""
        self.sums = np.ascontiguousarray(arrays["sums"], np.float32)
        self._share = float(arrays["share"])
        if self.exposure is not None:
            self.exposure.restore(arrays)
        if self.texture is not None:
            self.texture.gradient[:] = arrays["texture.gradient"]
        for name, group in self.groups.items():
            values = np.ascontiguousarray(arrays[f"{name}.values"], np.float32)
            if name in self.per_gaussian:
                group.values, group.gradient = values, np.empty_like(values)
            else:
                group.values[:] = values  # networks and texture look into these arrays
            group.first = np.ascontiguousarray(arrays[f"{name}.first"], np.float32)
            group.second = np.ascontiguousarray(arrays[f"{name}.second"], np.float32)

    def model(self, info: dict[str, object]) -> SubmapModel:
        """A copy of what has been learned."""
        gaussians = Gaussians(*(self.groups[name].values.copy() for name in FIELDS))
        background = appearance = None
        if self.networks is not None:
            background = self.networks.exported_background()
            features = self.groups[FEATURES].values if FEATURES in self.groups else None
            gaussians, appearance = self.networks.exported_colours(gaussians, features)
        texture = None if self.texture is None else self.texture.exported()
        return SubmapModel(gaussians, background, texture, self.floor, self.config.antialiased, info, appearance)
