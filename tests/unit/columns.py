"""A world of columns for the map builder: every occupied cell of an occupancy map stands to the ceiling.

It answers as a perfect floor-aware model would: alpha is 1 where a ray meets a column before the floor, 0 where it
meets the floor, whether anybody knows that floor or not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.directions import Sphere
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from nvsim.render.backends import RenderOutput

_FAR = 5.0  # meters; no corridor is longer
_STEP = 0.02  # meters along a ray
_BLOCK = 20  # steps at a time: most rays meet a column long before _FAR
_AZIMUTHS = 1440
_HEADINGS = np.arange(_AZIMUTHS) / _AZIMUTHS * 2 * np.pi
_DIRECTIONS = np.stack([np.sin(_HEADINGS), np.cos(_HEADINGS)], axis=-1)


class Columns:
    """noise: standard deviation added to alpha; equal views get equal noise. `rendered` counts views."""

    def __init__(self, occupancy: OccupancyMap, noise: float = 0.0) -> None:
        self._map, self._noise = occupancy, noise
        self._ways: dict[tuple[float, ...], NDArray[np.float64]] = {}
        self.rendered = 0

    def views(
        self, position: NDArray[np.floating], cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> tuple[int, list[RenderOutput]]:
        self.rendered += len(cameras)
        return 0, [self._view(camera) for camera in cameras]

    def panorama(self, sphere: Sphere, mask: NDArray[np.bool_], submap: int | None = None) -> tuple[int, RenderOutput]:
        self.rendered += 1
        return 0, self._view(sphere)

    def _view(self, camera: Camera | Sphere) -> RenderOutput:
        rays = camera.rays().astype(np.float64)
        flat = np.hypot(rays[..., 0], rays[..., 1])
        to_floor = flat * camera.position[2] / np.maximum(-rays[..., 2], 1e-6)
        turn = np.arctan2(rays[..., 0], rays[..., 1]) / (2 * np.pi) * _AZIMUTHS
        clear = self._clear_way(tuple(camera.position[:2]))[np.round(turn).astype(int) % _AZIMUTHS]
        alpha = (np.minimum(to_floor, _FAR) > clear).astype(np.float64)
        if self._noise:
            pose = camera.position if isinstance(camera, Sphere) else camera.camera_to_world
            seed = np.abs(np.round(pose * 1000)).astype(np.int64).sum()
            alpha = np.clip(alpha + np.random.default_rng(int(seed)).normal(0, self._noise, alpha.shape), 0, 1)
        return RenderOutput(alpha=alpha.astype(np.float32), normal=np.zeros((*alpha.shape, 3), np.float32))

    def _clear_way(self, xy: tuple[float, float]) -> NDArray[np.float64]:
        """(azimuths,) meters to the first column."""
        if xy not in self._ways:
            first, open_ways = np.full(_AZIMUTHS, 2 * _FAR), np.arange(_AZIMUTHS)
            along = np.arange(0, _FAR, _STEP)
            for block in np.split(along, range(_BLOCK, len(along), _BLOCK)):
                hit = (
                    self._map.states_at(np.array(xy) + block[None, :, None] * _DIRECTIONS[open_ways, None, :])
                    == OCCUPIED
                )
                met = hit.any(axis=1)
                first[open_ways[met]] = block[np.argmax(hit[met], axis=1)]
                open_ways = open_ways[~met]
            self._ways[xy] = first
        return self._ways[xy]

    def support(self, xy: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Floor that is known: free cells."""
        return self._map.states_at(xy) == FREE


def flat_floor(xy: NDArray[np.floating]) -> NDArray[np.floating]:
    """Height 0 everywhere."""
    return np.zeros(np.shape(xy)[:-1])


def room(width: float, height: float, resolution: float = 0.05, wall: float = 0.1) -> OccupancyMap:
    """A free rectangle from (0, 0) to (width, height) meters inside walls, in 4 m of unknown."""
    margin = 4.0
    columns, rows = (round((s + 2 * margin) / resolution) for s in (width, height))
    empty = OccupancyMap(np.full((rows, columns), UNKNOWN, np.uint8), resolution, (-margin, -margin))
    walled = fill(empty, -wall, -wall, width + wall, height + wall, OCCUPIED)
    return fill(walled, 0, 0, width, height, FREE)


def fill(occupancy: OccupancyMap, x0: float, y0: float, x1: float, y1: float, state: np.uint8) -> OccupancyMap:
    """A copy of the map in which the cells with their centers in a rectangle have `state`."""
    centers = occupancy.centers()
    x, y = centers[..., 0], centers[..., 1]
    cells = occupancy.cells.copy()
    cells[(x > x0) & (x < x1) & (y > y0) & (y < y1)] = state
    return OccupancyMap(cells, occupancy.resolution, occupancy.origin)
