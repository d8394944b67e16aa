"""One training step of a model: draw a view, compute the loss, propagate its gradient, update every parameter.

`nvsim.training.devices` stores and draws the Gaussians, on the CPU or a GPU.

`Exposure` learns a gain per image and channel. A camera with automatic exposure records one wall with many
brightnesses, which a static scene cannot explain. The gains are kept near one and are not part of the model. Rendered
views have the average exposure of the images.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.kernels import njit, prange
from nvsim.render.floor_rays import meet_floor, pack_floor
from nvsim.render.sh_polynomials import ROW
from nvsim.render.sky import evaluate, evaluate_gradient, pack_camera
from nvsim.render.workspace import LOCK
from nvsim.splats.types import Gaussians, SubmapModel
from nvsim.training.config import LossConfig, TrainingConfig
from nvsim.training.devices.choice import hold_on_device
from nvsim.training.devices.types import FEATURES, Stopwatch
from nvsim.training.floor_paint import LearnedTexture
from nvsim.training.loss.alpha import alpha_loss
from nvsim.training.loss.floor_aware import FloorAwareLoss, LossValues
from nvsim.training.networks import Networks
from nvsim.training.optimizer import BETA1, BETA2, ParameterGroup
from nvsim.training.views import TrainingView

Float32 = NDArray[np.float32]
_F = np.float32
HOLD = 1e-3
"""Weight of half the squared logarithm of every gain."""


@dataclass(eq=False)
class ViewBuffers:
    """Buffers for one image size.

    background  (3, H, W) colors
    hits        (3, H, W) of `floor_rays.meet_floor`
    rows        (H, 9, 3) scratch of the background's gradient
    inlier      (H, W) bool, pixels that the robust mask keeps
    nowhere     (H, W) bool, an empty floor mask
    """

    loss: FloorAwareLoss
    background: Float32
    hits: Float32
    rows: Float32
    inlier: NDArray[np.bool_]
    nowhere: NDArray[np.bool_]

    @staticmethod
    def of(config: LossConfig, width: int, height: int) -> ViewBuffers:
        return ViewBuffers(
            FloorAwareLoss(config, width, height),
            np.zeros((3, height, width), np.float32),
            np.empty((3, height, width), np.float32),
            np.empty((height, ROW, 3), np.float32),
            np.ones((height, width), np.bool_),
            np.zeros((height, width), np.bool_),
        )


TEXTURE_STEPS = 4
"""Number of steps whose gradients the texture collects before an update, because a view covers few of its texels."""


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
"""The parts of a step, in order."""


class ModelFit:
    """The parameters of a model under training, their moments, and the statistics for densification.

    held    the Gaussians, on the CPU or a GPU
    groups  the other parameters, on the CPU
    parts   milliseconds of the parts of the last step
    """

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
        self.parts: dict[str, float] = {}
        self.held = hold_on_device(gaussians, networks, config)
        self.groups: dict[str, ParameterGroup] = {} if networks is None else networks.groups()
        self._painter = None if networks is None else networks.background
        if texture is not None:
            self.groups["texture"] = ParameterGroup.of(texture.values, config.rate.texture, texture.gradient)
        self._canvases: dict[tuple[int, int], ViewBuffers] = {}
        self._heights, self._grid = pack_floor(floor)
        self._share = 0.0
        self._watch = Stopwatch()

    @property
    def gaussians(self) -> Gaussians:
        """Arrays that can be changed in place until the next step."""
        return self.held.gaussians

    def canvas(self, width: int, height: int) -> ViewBuffers:
        key = (width, height)
        if key not in self._canvases:
            self._canvases[key] = ViewBuffers.of(self.config.loss, width, height)
        return self._canvases[key]

    def paint(self, camera: Camera, transmittance: Float32, floor: NDArray[np.bool_] | None = None) -> Float32:
        """(3, H, W) the background of the view of the last `look`, in a buffer that the next view of this size
        overwrites. The texture is added only at pixels with enough transmittance (H, W), and at those of `floor` (H,
        W)."""
        canvas = self.canvas(camera.intrinsics.width, camera.intrinsics.height)
        if self.networks is None or self._painter is None:
            return canvas.background
        evaluate(camera, self.networks.background_coefficients(self._share), canvas.background)
        if self.texture is not None:
            wanted = canvas.nowhere if floor is None else floor
            meet_floor(pack_camera(camera), self._heights, self._grid, wanted, transmittance, canvas.hits)
            self.texture.add(canvas.hits, canvas.background)
        return canvas.background

    def begin_view(self, camera: Camera, name: str | None = None) -> None:
        """Begins a view: that of the training image `name`, or, without a name, any other view."""
        if self.networks is not None:
            self.networks.select_embedding(camera.position, name)

    def draw(self, camera: Camera, sh_degree: int | None = None) -> tuple[Float32, Float32]:
        """Color of the Gaussians (H, W, 3) and transmittance (H, W) of the view of the last `look`."""
        return self.held.draw(camera, sh_degree, self.config.antialiased, self._watch)

    def composite(self, camera: Camera) -> tuple[Float32, Float32]:
        """The image (H, W, 3), not clamped, and alpha (H, W)."""
        with LOCK, torch.no_grad():
            self.begin_view(camera)
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
        """Draws view `index` and computes every group's gradient. The error of each pixel is in the canvas's loss.

        inlier  (H, W) bool, pixels without transients
        judge   can change `inlier` after it gets the color of the Gaussians (H, W, 3), the transmittance (H, W), and
                the background (3, H, W)
        """
        camera = view.camera
        canvas = self.canvas(camera.intrinsics.width, camera.intrinsics.height)
        watch = self._watch = Stopwatch()
        with LOCK:
            self.begin_view(camera, view.name)
            rgb, transmittance = self.draw(camera, sh_degree)
            background = self.paint(camera, transmittance, view.floor)
            watch.record_lap("background")
            loss = canvas.loss
            if self.exposure is not None:
                self.exposure.apply(index, rgb, background)
            if judge is not None:
                judge(rgb, transmittance, background)
            if view.usable is not None:
                inlier &= view.usable
            values = loss(rgb, transmittance, background, view.image, view.floor, inlier, view.doubtful)
            if self.config.loss.alpha > 0:
                weight = self.config.loss.alpha
                more = alpha_loss(1 - transmittance, background, view.image, weight, loss.d_alpha, view.usable)
                values = replace(values, total=values.total + more)
            if self.exposure is not None:
                self.exposure.learn(index, rgb, background, loss.d_rgb, loss.d_background)
            watch.record_lap("loss")
            self.held.differentiate(transmittance, loss.d_rgb, loss.d_alpha, watch)
            if self.networks is not None and self._painter is not None:
                self.networks.backdrop_gradient(evaluate_gradient(camera, loss.d_background, canvas.rows))
            if self.networks is not None:
                self.networks.propagate_gradients()
            if self.texture is not None and self.config.loss.floor > 0:
                self.texture.collect(canvas.hits, view.floor, loss.d_background)
            watch.record_lap("background_backward")
        self.parts = watch.laps
        return values

    def move(self, step: int) -> None:
        """Makes update number `step` (from 1) of every parameter."""
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
            self.held.step(step, {name: factor**share for name, factor in decay.items()})
            for name, group in self.groups.items():
                if name != "texture":
                    group.step(step, decay.get(name, 1.0) ** share)
                elif step % TEXTURE_STEPS == 0:
                    group.step(step // TEXTURE_STEPS, decay[name] ** share)
                    group.gradient[:] = 0
        self.parts["optimizer"] = 1e3 * (time.perf_counter() - started)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All arrays that a step changes, by name, of any shape."""
        arrays: dict[str, NDArray[np.generic]] = {"share": np.array(self._share), **self.held.state()}
        for name, group in self.groups.items():
            arrays[f"{name}.values"] = group.values
            arrays[f"{name}.first"], arrays[f"{name}.second"] = group.first, group.second
        if self.texture is not None:
            arrays["texture.gradient"] = self.texture.gradient
        return arrays if self.exposure is None else {**arrays, **self.exposure.state()}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Restores the `arrays` of `state`, of any shape, in a fit with an equal configuration and equal views."""
        self.held.restore(arrays)
        self._share = float(arrays["share"])
        if self.exposure is not None:
            self.exposure.restore(arrays)
        if self.texture is not None:
            self.texture.gradient[:] = arrays["texture.gradient"]
        for name, group in self.groups.items():
            group.values[:] = arrays[f"{name}.values"]  # networks and texture are views of these arrays
            group.first = np.ascontiguousarray(arrays[f"{name}.first"], np.float32)
            group.second = np.ascontiguousarray(arrays[f"{name}.second"], np.float32)

    def model(self, info: dict[str, object]) -> SubmapModel:
        """A copy of the trained model."""
        gaussians = Gaussians(*(array.copy() for array in self.held.gaussians.arrays))
        background = appearance = None
        if self.networks is not None:
            background = self.networks.exported_background()
            gaussians, appearance = self.networks.exported_colors(gaussians, self.held.features)
        texture = None if self.texture is None else self.texture.exported()
        return SubmapModel(gaussians, background, texture, self.floor, self.config.antialiased, info, appearance)


@njit(parallel=True, cache=True, fastmath=True)
def _apply(
    gain: Float32,  # (3,)
    rgb: Float32,  # (H, W, 3) changed
    background: Float32,  # (3, H, W) changed
) -> None:
    height, width, _ = rgb.shape
    for y in prange(height):
        for x in range(width):
            for c in range(3):
                rgb[y, x, c] *= gain[c]
        for c in range(3):
            for x in range(width):
                background[c, y, x] *= gain[c]


@njit(parallel=True, cache=True, fastmath=True)
def _apply_gradient(
    gain: Float32,  # (3,)
    rgb: Float32,  # (H, W, 3) with exposure
    background: Float32,  # (3, H, W) with exposure
    d_rgb: Float32,  # (H, W, 3) changed
    d_background: Float32,  # (3, H, W) changed
    rows: Float32,  # (H, 3) out: the gradient of the logarithm of the gain, row by row
) -> None:
    # The images include the exposure, so their sums are already gradients of the logarithm of the gain.
    height, width, _ = rgb.shape
    for y in prange(height):
        for c in range(3):
            total = _F(0)
            for x in range(width):
                total += d_rgb[y, x, c] * rgb[y, x, c] + d_background[c, y, x] * background[c, y, x]
                d_rgb[y, x, c] *= gain[c]
                d_background[c, y, x] *= gain[c]
            rows[y, c] = total


class Exposure:
    """log_gains (views, 3) float32, with the moments of an Adam optimizer that changes only the row of the current
    view. In a short training a view is seen a dozen times, so every visit must have an effect."""

    def __init__(self, views: int, rate: float) -> None:
        self._rate = rate
        self.log_gains = np.zeros((views, 3), np.float32)
        self._first, self._second = np.zeros((views, 3)), np.zeros((views, 3))
        self._visits = np.zeros(views, np.int64)

    def apply(self, view: int, rgb: Float32, background: Float32) -> None:
        """Multiplies rgb (H, W, 3) and background (3, H, W) by the gains of the view, in place."""
        _apply(np.exp(self.log_gains[view]), rgb, background)

    def learn(
        self,
        view: int,
        rgb: Float32,
        background: Float32,
        d_rgb: Float32,
        d_background: Float32,
    ) -> None:
        """Converts gradients of the exposed images (of `apply`) to those of the unexposed ones, in place, and updates
        the view's gains. `rgb` and `d_rgb` are (H, W, 3), `background` and `d_background` (3, H, W)."""
        rows = np.empty((rgb.shape[0], 3), np.float32)
        _apply_gradient(np.exp(self.log_gains[view]), rgb, background, d_rgb, d_background, rows)
        slope = rows.sum(axis=0, dtype=np.float64) + HOLD * self.log_gains[view]
        self._visits[view] += 1
        self._first[view] = BETA1 * self._first[view] + (1 - BETA1) * slope
        self._second[view] = BETA2 * self._second[view] + (1 - BETA2) * slope**2
        first = self._first[view] / (1 - BETA1 ** self._visits[view])
        second = self._second[view] / (1 - BETA2 ** self._visits[view])
        self.log_gains[view] -= (self._rate * first / (np.sqrt(second) + 1e-15)).astype(np.float32)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All arrays that `learn` changes, by name: (views, 3), and the visits (views,)."""
        return {
            "exposure.log_gains": self.log_gains,
            "exposure.first": self._first,
            "exposure.second": self._second,
            "exposure.visits": self._visits,
        }

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Restores the `arrays` of `state`: (views, 3), and the visits (views,)."""
        for name, array in self.state().items():
            array[:] = arrays[name]
