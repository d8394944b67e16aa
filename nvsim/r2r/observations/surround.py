"""What a model shows all around one place: eighteen narrow views, drawn once, from which every image of a scan made
there is sampled. So no image has seams, and none contradicts another."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.r2r.observations.resampling import BLEND, sample
from nvsim.render.backends import Backend
from nvsim.render.equirectangular import axes_ahead, views_around
from nvsim.render.kernel_types import Float32, Mask
from nvsim.render.model import render_model
from nvsim.render.workspace import LOCK, tiles_of
from nvsim.splats.types import SubmapModel

_CHANNELS = frozenset({"rgb", "alpha", "depth"})
_ROUND = 3  # pixels of a narrow view around those whose ray it looks along nearly straight: samples lie that far off
_FARTHEST = math.radians(38)  # from a narrow view's axis to a ray for which it counts, rounded up


@dataclass(frozen=True, eq=False)
class Surround:
    """position  (3,) metres, world
    focal     of the narrow views, pixels
    colours   (18, S, S, 3) float32, not clamped
    solids    (18, S, S, 2) float32: alpha of the Gaussians, and alpha times their distance along the ray, metres
    """

    position: NDArray[np.float64]
    focal: float
    colours: Float32
    solids: Float32

    def colour(self, camera: Camera, finer: int = 1) -> Float32:
        """(H, W, 3) the view of `camera`, which stands at `position`; `finer` x `finer` samples for each pixel."""
        image = np.empty((camera.intrinsics.height, camera.intrinsics.width, 3), np.float32)
        self._sample(camera, finer, image, np.empty((0, 0, 2), np.float32))
        return image

    def colour_and_solid(self, camera: Camera, finer: int = 1) -> tuple[Float32, Float32]:
        """The same, and (H, W, 2) alpha and alpha times metres along the ray."""
        shape = camera.intrinsics.height, camera.intrinsics.width
        colour, solid = np.empty((*shape, 3), np.float32), np.empty((*shape, 2), np.float32)
        self._sample(camera, finer, colour, solid)
        return colour, solid

    def _sample(self, camera: Camera, finer: int, colour: Float32, solid: Float32) -> None:
        k = camera.intrinsics
        axes = axes_ahead()
        rotation = np.ascontiguousarray(camera.rotation, np.float32)
        corner = math.atan(math.hypot(k.width, k.height) / 2 / k.fx)
        reach = math.cos(min(corner + _FARTHEST, math.pi))
        near = np.flatnonzero(axes[:, 2] @ rotation[:, 2] >= reach).astype(np.int64)
        solids = self.solids if solid.size else self.solids[:0]
        with LOCK:
            sample(
                self.colours, solids, axes, np.float32(self.focal), near, rotation, np.float32(k.fx), finer,
                colour, solid,
            )  # fmt: skip


def draw_surround(
    model: SubmapModel,
    position: NDArray[np.floating],
    focal: float,
    backend: Backend = "auto",
    over: Surround | None = None,
) -> Surround:
    """Draws the narrow views of `model` from `position` (3,), `focal` pixels to the unit; into the arrays of `over`
    where they fit, which is then spent: to allocate them takes longer than to fill them.

    Raises InputError when the backend cannot run here.
    """
    at = np.asarray(position, np.float64)
    cameras, tiles = _cameras(at, focal), _tiles_needed(focal)
    side = cameras[0].intrinsics.width
    if over is not None and over.colours.shape[1] == side:
        colours, solids = over.colours, over.solids
    else:
        colours = np.empty((len(cameras), side, side, 3), np.float32)
        solids = np.empty((len(cameras), side, side, 2), np.float32)
    lengths = _ray_lengths(cameras[0])
    for i, camera in enumerate(cameras):
        view = render_model(model, camera, _CHANNELS, tiles[i], backend)
        assert view.rgb is not None and view.alpha is not None and view.depth is not None
        colours[i], solids[i, ..., 0] = view.rgb, view.alpha
        np.multiply(view.depth, view.alpha, out=view.depth)
        np.multiply(view.depth, lengths, out=solids[i, ..., 1])
    return Surround(at, cameras[0].intrinsics.fx, colours, solids)


def _cameras(position: NDArray[np.float64], focal: float) -> list[Camera]:
    # `views_around` takes the width of a panorama and makes its views 1.2 times as fine.
    return views_around(position, round(2 * math.pi * focal / 1.2), 0.0)


def _ray_lengths(camera: Camera) -> Float32:
    k = camera.intrinsics
    u, v = (np.arange(k.width) + 0.5 - k.cx) / k.fx, (np.arange(k.height) + 0.5 - k.cy) / k.fy
    return np.sqrt(1 + u[None, :] ** 2 + v[:, None] ** 2).astype(np.float32)


@lru_cache(maxsize=4)
def _tiles_needed(focal: float) -> tuple[Mask, ...]:
    """Of every narrow view the tiles that `sample` reads for pinholes of any direction."""
    import cv2

    ahead = axes_ahead()[:, 2]
    round_about = np.ones((2 * _ROUND + 1,) * 2, np.uint8)
    found = []
    for i, camera in enumerate(_cameras(np.zeros(3), focal)):
        cosines = camera.rays() @ ahead.T
        counts = cosines[..., i] >= cosines.max(axis=-1) - BLEND
        found.append(tiles_of(cv2.dilate(counts.astype(np.uint8), round_about).astype(bool)))
    return tuple(found)
