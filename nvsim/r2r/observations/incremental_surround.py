"""Draws a model around a position incrementally: each image adds the tiles of the narrow views that it needs.

The images equal those from a complete `Surround`, but only visible parts are drawn. Recent positions are cached, so
that a turn on the spot draws only new parts.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.r2r.observations.skybox import as_bytes
from nvsim.r2r.observations.surround import (
    CHANNELS,
    ROUND,
    narrow_cameras,
    sample_view,
    seen_by,
    tiles_needed,
)
from nvsim.render.backends import resolve_backend
from nvsim.render.equirectangular import axes_ahead
from nvsim.render.kernel_types import TILE, Float32, Mask
from nvsim.render.model import render_model
from nvsim.render.workspace import pixels_of
from nvsim.splats.types import SubmapModel

MEMORY = 1 << 30
"""Largest memory of the cache in bytes. The position of the current view is always kept."""
FINER = 1.08
"""Resolution of the narrow views relative to the center of a view. For 640 x 480 pixels and 60 degrees, the focal
lengths are 448 and 416 pixels. Strips with faces of 512 pixels are made from 512."""
_STEP = 32  # pixels; views of similar size share narrow views


class GrowingSurround:
    """The narrow views around `position` (3,), meters, world, with a focal length of `focal` pixels.

    If `solid` is true, they also have alpha and distances. Not thread-safe.

    bytes  memory of its arrays when all tiles are drawn
    """

    def __init__(self, position: NDArray[np.floating], focal: float, solid: bool) -> None:
        self._cameras, self._needed = narrow_cameras(np.asarray(position, np.float64), focal), tiles_needed(focal)
        self._focal = self._cameras[0].intrinsics.fx
        self._nominal = focal
        side, count = self._cameras[0].intrinsics.width, len(self._cameras)
        # The images have eight bits in the end, and uint8 needs a quarter of the memory of float32.
        self._colors = np.empty((count, side, side, 3), np.uint8)
        self._solids = np.empty((count, side, side, 2) if solid else (0, side, side, 2), np.float32)
        self._drawn = np.zeros((count, *self._needed[0].shape), np.bool_)

    @property
    def bytes(self) -> int:
        return self._colors.nbytes + self._solids.nbytes

    def image(self, model: SubmapModel, camera: Camera) -> tuple[Float32, Float32]:
        """Returns the view of a `camera` at the position, and draws missing tiles with `model`.

        The results are (H, W, 3) float32 colors from 0 to 255, and (H, W, 2) float32: alpha, and alpha times meters
        along the ray, or (0, 0, 2) without `solid`.

        Raises InputError if the backend is not available.
        """
        near = seen_by(camera)
        outside = _outside(camera, self._nominal)
        whole = resolve_backend("auto") == "gsplat"  # gsplat can only draw complete views
        todo = [(int(i), self._needed[i] & ~outside[i] & ~self._drawn[i]) for i in near]
        todo = [(i, tiles) for i, tiles in todo if tiles.any()]
        if todo and not whole:  # a graphics card caches the arrays of a model without appearance
            model = replace(model, gaussians=model.gaussians_at(camera.position), appearance=None)
        for i, tiles in todo:
            self._draw(model, i, self._needed[i] if whole else tiles)
        k = camera.intrinsics
        color = np.empty((k.height, k.width, 3), np.float32)
        solid = np.empty((k.height, k.width, 2) if len(self._solids) else (0, 0, 2), np.float32)
        sample_view(self._colors, self._solids, self._focal, camera, 1, color, solid)
        return color, solid

    def _draw(self, model: SubmapModel, index: int, tiles: Mask) -> None:
        # Uses the camera of the whole view even for a few tiles. A cropped camera rounds differently, so the result
        # would depend on earlier images.
        camera, solid = self._cameras[index], len(self._solids) > 0
        view = render_model(model, camera, CHANNELS if solid else frozenset({"rgb"}), tiles)
        assert view.rgb is not None
        new = pixels_of(tiles, camera.intrinsics.height, camera.intrinsics.width)[..., None]
        np.copyto(self._colors[index], as_bytes(view.rgb), where=new)
        if solid:
            assert view.alpha is not None and view.depth is not None
            along = view.alpha * view.depth * camera.intrinsics.ray_lengths()
            np.copyto(self._solids[index], np.stack([view.alpha, along], axis=-1), where=new)
        self._drawn[index] |= tiles


def _outside(camera: Camera, focal: float) -> Mask:
    """Returns (18, lines, columns) bool: tiles of the narrow views that are not close to any ray of `camera`."""
    k = camera.intrinsics
    a, b = k.width / 2 / k.fx, k.height / 2 / k.fy
    sides = np.array([[1, 0, a], [-1, 0, a], [0, 1, b], [0, -1, b], [0, 0, 1]], np.float32)  # inward normals
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    corners = _corners(focal)  # (18, lines + 1, columns + 1, 3)
    beyond = corners @ (sides @ camera.rotation.T.astype(np.float32)).T < -np.float32((ROUND + 1) / focal)
    four = beyond[:, 1:, 1:] & beyond[:, :-1, 1:] & beyond[:, 1:, :-1] & beyond[:, :-1, :-1]
    return np.asarray(four.any(axis=-1), np.bool_)


@lru_cache(maxsize=4)
def _corners(focal: float) -> Float32:
    """Returns (18, lines + 1, columns + 1, 3) unit directions, world, of the corners of the tiles."""
    k = narrow_cameras(np.zeros(3), focal)[0].intrinsics
    at = (np.arange(0, k.width + 1, TILE) - k.cx) / k.fx
    local = np.stack([*np.broadcast_arrays(at[None, :], at[:, None]), np.ones((len(at), len(at)))], axis=-1)
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    return np.asarray(np.einsum("lcj,kji->klci", local, axes_ahead()), np.float32)


class PlacesSeen:
    """A thread-safe cache of `GrowingSurround`s."""

    def __init__(self, memory: int = MEMORY) -> None:
        self._memory, self._lock = memory, threading.Lock()
        self._places: OrderedDict[tuple[float, ...], GrowingSurround] = OrderedDict()

    def image(self, model: SubmapModel, camera: Camera, solid: bool) -> tuple[Float32, Float32]:
        """Returns `GrowingSurround.image` at the position of `camera`.

        The results are (H, W, 3) float32 colors from 0 to 255, and, if `solid` is true, (H, W, 2) alpha and alpha times
        meters.
        """
        focal = _STEP * round(FINER * camera.intrinsics.fx / _STEP + 0.3)
        key = (*camera.position.tolist(), focal, solid)
        with self._lock:
            place = self._places.get(key)
            if place is None:
                place = self._places[key] = GrowingSurround(camera.position, focal, solid)
            self._places.move_to_end(key)
            while len(self._places) > 1 and sum(p.bytes for p in self._places.values()) > self._memory:
                self._places.popitem(last=False)
            return place.image(model, camera)

    def clear(self) -> None:
        """Removes all positions."""
        with self._lock:
            self._places.clear()
