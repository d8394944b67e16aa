"""Eighteen narrow views around one position, from which all images of a viewpoint are sampled.

They are drawn once, so the images have no seams and are consistent with each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import FLAGS
from nvsim.render.backends import Backend
from nvsim.render.equirectangular import axes_ahead, views_around
from nvsim.render.kernel_types import Float32, Int64, Mask
from nvsim.render.model import render_model
from nvsim.render.workspace import LOCK, tiles_of
from nvsim.splats.types import SubmapModel

_F = np.float32
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)
BLEND = _F(0.03)
"""A view contributes if the cosine between its axis and the ray is less than this below the largest cosine."""
CHANNELS = frozenset({"rgb", "alpha", "depth"})
ROUND = 3  # margin in pixels around the pixels that a narrow view contributes, for the samples next to them
_FARTHEST = math.radians(38)  # largest angle from a narrow view's axis to a ray it contributes to, rounded up
_ALIKE = (0, 0, 2, 2, 2, 2, 2, 2, 0, 1, 1, 1, 0, 1, 1, 1, 0, 0)
# For each view, how many places earlier `views_around` has a view of equal elevation a quarter turn away; 0: none.


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _add_sample(
    colors: NDArray[Any],  # (views, S, S, 3), see `sample`
    solids: Float32,  # (views, S, S, 2)
    view: int,
    u: np.float32,  # column and line from the center of the first pixel; the next column and line exist too
    v: np.float32,
    weight: np.float32,
    pixel: Float32,  # (5,) the sample is added to it
) -> None:
    column, line = np.int64(u), np.int64(v)
    fu, fv = u - _F(column), v - _F(line)
    w00, w01 = weight * (_ONE - fv) * (_ONE - fu), weight * (_ONE - fv) * fu
    w10, w11 = weight * fv * (_ONE - fu), weight * fv * fu
    if colors.shape[0] > 0:
        for c in range(3):
            pixel[c] += (
                w00 * colors[view, line, column, c]
                + w01 * colors[view, line, column + 1, c]
                + w10 * colors[view, line + 1, column, c]
                + w11 * colors[view, line + 1, column + 1, c]
            )
    if solids.shape[0] > 0:
        for c in range(2):
            pixel[3 + c] += (
                w00 * solids[view, line, column, c]
                + w01 * solids[view, line, column + 1, c]
                + w10 * solids[view, line + 1, column, c]
                + w11 * solids[view, line + 1, column + 1, c]
            )


@njit(parallel=True, cache=True, nogil=True, fastmath=FLAGS, error_model="numpy")
def sample(
    colors: NDArray[Any],  # (views, S, S, 3) narrow views, float32 or uint8; (0, ...) if not needed
    solids: Float32,  # (views, S, S, 2) alpha, and alpha times meters along the ray; (0, ...) if not needed
    axes: Float32,  # (views, 3, 3) rows right, down and ahead of each narrow view, world
    focal: np.float32,  # focal length of the narrow views, pixels
    near: Int64,  # (n,) indices of the narrow views that the camera may see
    rotation: Float32,  # (3, 3) columns right, down and ahead of the camera, world
    pinhole_focal: np.float32,  # focal length of the camera, pixels; its principal point is the image center
    finer: int,  # samples per pixel in each direction
    color: Float32,  # (H, W, 3) output, or (0, 0, 3)
    solid: Float32,  # (H, W, 2) output, or (0, 0, 2)
) -> None:
    """Fills the image (H, W) of the camera. Every pixel is the mean of `finer` x `finer` bilinear samples.

    A pixel is sampled from the views whose axis is closest to its ray. If two views are about equally close, they are
    blended, so that differences fade. `nvsim.render.equirectangular` does this for one image of the whole sphere.
    """
    side = max(colors.shape[1], solids.shape[1])
    middle, most = _F(side) * _HALF - _HALF, _F(side - 2)
    height, width = max(color.shape[0], solid.shape[0]), max(color.shape[1], solid.shape[1])
    step, first = _ONE / _F(finer), (_ONE / _F(finer) - _ONE) * _HALF
    for row in prange(height):
        pixel = np.empty(5, np.float32)
        weights = np.empty(near.shape[0], np.float32)
        for column in range(width):
            # Measured from the principal point. The views are selected once for the whole pixel.
            u0, v0 = _F(column) + _HALF - _F(width) * _HALF, _F(row) + _HALF - _F(height) * _HALF
            a, b = u0 / pinhole_focal, v0 / pinhole_focal
            x = rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2]
            y = rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2]
            z = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2]
            scale = _ONE / math.sqrt(x * x + y * y + z * z)
            best = _ZERO
            for i in range(near.shape[0]):
                k = near[i]
                weights[i] = scale * (axes[k, 2, 0] * x + axes[k, 2, 1] * y + axes[k, 2, 2] * z)
                best = max(best, weights[i])
            total = _ZERO
            for i in range(near.shape[0]):
                weights[i] = max(weights[i] - best + BLEND, _ZERO)
                total += weights[i]
            pixel[:] = _ZERO
            for i in range(near.shape[0]):
                if weights[i] <= _ZERO:
                    continue
                k, weight = near[i], weights[i] * step * step / total
                for part in range(finer * finer):
                    a = (u0 + first + _F(part % finer) * step) / pinhole_focal
                    b = (v0 + first + _F(part // finer) * step) / pinhole_focal
                    x = rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2]
                    y = rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2]
                    z = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2]
                    ahead = focal / (axes[k, 2, 0] * x + axes[k, 2, 1] * y + axes[k, 2, 2] * z)
                    u = ahead * (axes[k, 0, 0] * x + axes[k, 0, 1] * y + axes[k, 0, 2] * z) + middle
                    v = ahead * (axes[k, 1, 0] * x + axes[k, 1, 1] * y + axes[k, 1, 2] * z) + middle
                    u, v = min(max(u, _ZERO), most), min(max(v, _ZERO), most)
                    _add_sample(colors, solids, k, u, v, weight, pixel)
            if colors.shape[0] > 0:
                for c in range(3):
                    color[row, column, c] = pixel[c]
            if solids.shape[0] > 0:
                for c in range(2):
                    solid[row, column, c] = pixel[3 + c]


@dataclass(frozen=True, eq=False)
class Surround:
    """The narrow views of a model.

    position  (3,) meters, world
    focal     focal length of the narrow views, pixels
    colors    (18, S, S, 3) float32, not clamped
    solids    (18, S, S, 2) float32: alpha of the Gaussians, and alpha times their distance along the ray in meters
    """

    position: NDArray[np.float64]
    focal: float
    colors: Float32
    solids: Float32

    def color(self, camera: Camera, finer: int = 1) -> Float32:
        """Returns (H, W, 3) the view of a `camera` at `position`, with `finer` x `finer` samples for each pixel."""
        image = np.empty((camera.intrinsics.height, camera.intrinsics.width, 3), np.float32)
        nothing = np.empty((0, 0, 2), np.float32)
        sample_view(self.colors, self.solids[:0], self.focal, camera, finer, image, nothing)
        return image

    def color_and_solid(self, camera: Camera, finer: int = 1) -> tuple[Float32, Float32]:
        """Returns the view of `color`, and (H, W, 2) alpha and alpha times meters along the ray."""
        shape = camera.intrinsics.height, camera.intrinsics.width
        color, solid = np.empty((*shape, 3), np.float32), np.empty((*shape, 2), np.float32)
        sample_view(self.colors, self.solids, self.focal, camera, finer, color, solid)
        return color, solid


def draw_surround(
    model: SubmapModel,
    position: NDArray[np.floating],
    focal: float,
    backend: Backend = "auto",
    over: Surround | None = None,
) -> Surround:
    """Draws the narrow views of `model` from `position` (3,), meters, world, with a focal length of `focal` pixels.

    If the arrays of `over` have the right size, they are reused, and `over` becomes invalid. Allocating them takes
    longer than filling them.

    Raises InputError if the backend is not available.
    """
    at = np.asarray(position, np.float64)
    cameras, tiles = narrow_cameras(at, focal), tiles_needed(focal)
    side = cameras[0].intrinsics.width
    if over is not None and over.colors.shape[1] == side:
        colors, solids = over.colors, over.solids
    else:
        colors = np.empty((len(cameras), side, side, 3), np.float32)
        solids = np.empty((len(cameras), side, side, 2), np.float32)
    lengths = cameras[0].intrinsics.ray_lengths()
    for i, camera in enumerate(cameras):
        view = render_model(model, camera, CHANNELS, tiles[i], backend)
        assert view.rgb is not None and view.alpha is not None and view.depth is not None
        colors[i], solids[i, ..., 0] = view.rgb, view.alpha
        np.multiply(view.depth, view.alpha, out=view.depth)
        np.multiply(view.depth, lengths, out=solids[i, ..., 1])
    return Surround(at, cameras[0].intrinsics.fx, colors, solids)


def sample_view(
    colors: NDArray[np.generic],
    solids: Float32,
    focal: float,
    camera: Camera,
    finer: int,
    color: Float32,
    solid: Float32,
) -> None:
    """Samples the image of `camera` from narrow views and fills `color` (H, W, 3) and `solid` (H, W, 2).

    An empty output is skipped. The narrow views have a focal length of `focal` pixels: `colors` (18, S, S, 3), whose
    range the output has, and `solids` (18, S, S, 2) float32.
    """
    axes = axes_ahead()
    rotation = np.ascontiguousarray(camera.rotation, np.float32)
    near = seen_by(camera)
    with LOCK:
        sample(
            colors, solids, axes, np.float32(focal), near, rotation, np.float32(camera.intrinsics.fx), finer,
            color, solid,
        )  # fmt: skip


def seen_by(camera: Camera) -> NDArray[np.int64]:
    """Returns (n,) indices of the narrow views that contribute to rays of `camera`."""
    k = camera.intrinsics
    corner = math.atan(math.hypot(k.width, k.height) / 2 / k.fx)
    reach = math.cos(min(corner + _FARTHEST, math.pi))
    return np.flatnonzero(axes_ahead()[:, 2] @ camera.rotation[:, 2] >= reach).astype(np.int64)


def narrow_cameras(position: NDArray[np.float64], focal: float) -> list[Camera]:
    """Returns the eighteen cameras at `position` (3,), meters, world, with a focal length of `focal` pixels."""
    # `views_around` takes the width of a panorama and uses a 1.2 times longer focal length for its views.
    return views_around(position, round(2 * math.pi * focal / 1.2), 0.0)


@lru_cache(maxsize=4)
def tiles_needed(focal: float) -> tuple[Mask, ...]:
    """Returns for every narrow view (lines, columns) bool: the tiles that `sample` reads, for any camera direction."""
    import cv2

    ahead = axes_ahead()[:, 2]
    round_about = np.ones((2 * ROUND + 1,) * 2, np.uint8)
    found: list[Mask] = []
    for i, camera in enumerate(narrow_cameras(np.zeros(3), focal)):
        if _ALIKE[i]:
            found.append(found[i - _ALIKE[i]])
            continue
        rays = camera.rays()
        cosines = rays @ ahead[ahead @ ahead[i] >= math.cos(2 * _FARTHEST)].T
        counts = rays @ ahead[i] >= cosines.max(axis=-1) - BLEND
        found.append(tiles_of(cv2.dilate(counts.astype(np.uint8), round_about).astype(bool)))
    return tuple(found)
