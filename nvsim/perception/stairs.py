"""Stairs in a floor surface. The surface is the slope through the treads, which are up to half a step above and below
it. Rays can also meet this slope if they do not point down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_GENTLE, _STEEP = 0.35, 1.2  # rise over run of stairs; a smaller value is a ramp, a greater one a drop
_HALF_STEP, _GOING = 0.09, 0.3  # meters: half of the rise of a step, and its depth
_SAMPLE = 0.05  # meters between the tested points of a ray
_CHUNK = 4096  # rays
_ROUNDS = 4
_DOWN = -0.02  # as FloorSurface.distance_along_rays


@dataclass(frozen=True, eq=False)
class Stairs:
    """surface  the floor, including the slopes through the treads
    steep    (rows, columns) bool, the nodes of the surface that are on stairs
    """

    surface: FloorSurface
    steep: Mask

    @staticmethod
    def of(surface: FloorSurface) -> Stairs:
        """The stairs of a surface: nodes with the slope of stairs, away from drops, and one step before and behind
        them. So the first and the last riser are included."""
        slopes = [_smaller_change(surface.heights.astype(np.float64), axis) / surface.spacing for axis in (0, 1)]
        slope = np.hypot(*slopes)
        steep = (slope > _GENTLE) & (slope < _STEEP)
        for _ in range(round(_GOING / surface.spacing) if steep.any() else 0):
            steep = _with_neighbors(steep, surface.heights, _STEEP * surface.spacing)
        return Stairs(surface, steep)

    def __bool__(self) -> bool:
        return bool(self.steep.any())

    def is_on_stairs(self, xy: NDArray[np.floating]) -> Mask:
        """(...) bool: whether world places (..., 2 or 3), meters, are on stairs."""
        rows, columns = self.steep.shape
        with np.errstate(invalid="ignore"):
            c = np.round((xy[..., 0] - self.surface.origin[0]) / self.surface.spacing)
            r = np.round((xy[..., 1] - self.surface.origin[1]) / self.surface.spacing)
            inside = (c >= 0) & (c < columns) & (r >= 0) & (r < rows)
        on: Mask = self.steep[np.where(inside, r, 0).astype(np.int64), np.where(inside, c, 0).astype(np.int64)] & inside
        return on

    def half_step(self, xy: NDArray[np.floating]) -> Float32:
        """(...) float32: meters by which a tread can be above or below the surface at world places (..., 2 or 3)."""
        return np.where(self.is_on_stairs(xy), np.float32(_HALF_STEP), np.float32(0))

    def distance_along_rays(self, origin: NDArray[np.floating], rays: NDArray[np.floating]) -> Float32:
        """Distances (...) float32, meters, along unit `rays` (..., 3) from `origin` (3,) to the floor, inf if there is
        none. As `FloorSurface.distance_along_rays`, but on stairs also for rays that do not point down."""
        met = self.surface.distance_along_rays(origin, rays)
        if not self:
            return met
        shape, flat = met.shape, rays.reshape(-1, 3).astype(np.float64)
        found = met.reshape(-1).astype(np.float64)
        eye = np.asarray(origin, np.float64)
        for low, high in self._boxes():
            near, far = _ray_box_entries(eye, flat, low, high)
            crossing = np.flatnonzero((far > near) & (found > near))
            for start in range(0, len(crossing), _CHUNK):
                part = crossing[start : start + _CHUNK]
                found[part] = self._meters_to_stairs(eye, flat[part], near[part], far[part])
        return found.reshape(shape).astype(np.float32)

    def _boxes(self) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """The lower and the upper corner (3,) of each staircase, with a margin of one node."""
        from scipy.ndimage import find_objects, label

        boxes, origin, spacing = [], np.array(self.surface.origin), self.surface.spacing
        for y, x in find_objects(label(self.steep, np.ones((3, 3), int))[0]):
            heights = self.surface.heights[max(y.start - 1, 0) : y.stop + 1, max(x.start - 1, 0) : x.stop + 1]
            low, high = (origin + spacing * np.array([a, b]) for a, b in ((x.start - 1, y.start - 1), (x.stop, y.stop)))
            boxes.append((np.append(low, heights.min() - 0.1), np.append(high, heights.max() + 0.1)))
        return boxes

    def _meters_to_stairs(
        self,
        origin: NDArray[np.float64],  # (3,)
        rays: NDArray[np.float64],  # (M, 3)
        near: NDArray[np.float64],  # (M,) meters to the point where each ray enters the box
        far: NDArray[np.float64],  # (M,) meters to the point where it leaves the box
    ) -> NDArray[np.float64]:
        """(M,) meters to the point where a ray meets the surface from above, inf at a drop or without such a point."""
        count = max(2, int(np.ceil((far - near).max() / _SAMPLE)) + 1)
        share = np.linspace(0, 1, count)
        along = near[:, None] + share * (far - near)[:, None]
        places = origin + along[..., None] * rays[:, None]
        heights = self.surface.height_at(places).astype(np.float64)
        over = places[..., 2] - heights
        enters = (over[:, :-1] > 0) & (over[:, 1:] <= 0)
        first, row = enters.argmax(axis=1), np.arange(len(rays))
        a, b = over[row, first], over[row, first + 1]
        hit = along[row, first] + (along[row, first + 1] - along[row, first]) * a / np.where(a > b, a - b, 1.0)
        run = np.linalg.norm(places[row, first + 1, :2] - places[row, first, :2], axis=1)
        drop = np.abs(heights[row, first + 1] - heights[row, first]) > _STEEP * run + 0.02
        beneath = over[:, 0] <= 0
        return np.where(
            beneath,
            np.inf,
            np.where(enters.any(axis=1), np.where(drop, np.inf, hit), self._meters_to_floor_behind(origin, rays, far)),
        )

    def _meters_to_floor_behind(
        self, origin: NDArray[np.float64], rays: NDArray[np.float64], far: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(M,) meters to the floor behind the stairs, by the iteration of `FloorSurface.distance_along_rays`."""
        down = rays[:, 2] < _DOWN
        slope = np.where(down, rays[:, 2], -1.0)
        distance = far
        for _ in range(_ROUNDS + 1):
            reached = np.maximum(distance, far)
            distance = (self.surface.height_at(origin[:2] + reached[:, None] * rays[:, :2]) - origin[2]) / slope
        return np.where(down & (distance >= far), distance, np.inf)


def _smaller_change(heights: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """(rows, columns) the smaller change from each node to its two neighbors along an axis: a drop is on one side."""
    change = np.abs(np.diff(heights, axis=axis))
    if not change.size:
        return np.zeros_like(heights)
    first, last = np.take(change, [0], axis), np.take(change, [-1], axis)
    return np.minimum(np.concatenate([first, change], axis), np.concatenate([change, last], axis))


def _with_neighbors(nodes: Mask, heights: Float32, drop: float) -> Mask:
    """(rows, columns) `nodes` and their neighbors, except across a drop of more than `drop` meters."""
    found = nodes.copy()
    for here, there in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        level = np.abs(heights[here] - heights[there]) <= drop
        found[there] |= nodes[here] & level
        found[here] |= nodes[there] & level
    return found


def _ray_box_entries(
    origin: NDArray[np.float64], rays: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(M,) meters to the points where rays (M, 3) enter a box from `low` (3,) to `high` (3,), and where they leave it.
    If a ray misses the box, the second value is not greater than the first."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - origin) / rays, (high - origin) / rays
    inside, still = (origin >= low) & (origin <= high), rays == 0
    near = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(one, other)).max(axis=1)
    far = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(one, other)).min(axis=1)
    return np.maximum(near, 0.0), far
