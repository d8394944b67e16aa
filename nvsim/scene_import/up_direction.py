"""Find the up direction of a scene from its horizontal surfaces: floors and ceilings are the largest planes. Tables,
beds and seats are nearer to the floor than to the ceiling, and ceilings are usually brighter than floors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.scene_import.surface_points import SurfacePoints

_CONE = np.cos(np.radians(15.0))  # normals that belong to a candidate
_CANDIDATES, _PLANES = 6, 6
_APART = np.cos(np.radians(30.0))  # between candidates
_DIRECTIONS = 1500
_CHUNK = 128  # normals that are compared with all directions at once: few enough for the cache of the processor
_GIVEN = np.cos(np.radians(20.0))  # largest angle between a given axis and the up direction
_SNAP = 0.5  # degrees from an axis of the file within which the axis is used
_BAND = (0.1, 0.45)  # of the height of a storey: tables, beds and seats are there, rarely anything below a ceiling
_PLANE = 0.04  # of the height of a storey: largest distance of the points of its floor and ceiling
_HEIGHTS, _WALL = 16, 8  # heights of a column; number of full ones that make it a wall
_LARGE, _STOREY = 0.3, 0.6  # share of the largest plane, and of the largest gap between planes
_FEW = 100  # points that make a plane
_RATIO = 1.4  # of the surfaces near the floor to those near the ceiling that decides the sign
_BRIGHTER = 0.12  # difference of brightness between ceiling and floor that decides the sign
_FLAT_ON_TOP = np.cos(np.radians(25.0))  # least share of the up direction in the normals of furniture


@dataclass(frozen=True)
class UpDirection:
    """up     (3,) unit vector in the frame of the file
    sure   whether the surfaces alone decide between up and down
    share  root of the sum of the squared shares of the surface in the largest planes across `up`
    """

    up: NDArray[np.float64]
    sure: bool
    share: float


def find_up(
    surface: SurfacePoints, convention: NDArray[np.float64], given: NDArray[np.float64] | None = None
) -> UpDirection | None:
    """The up direction; None if the scene has no surfaces.

    convention  (3,) unit vector: up in most files of this format; decides if the surfaces do not
    given       (3,) unit vector: the user's axis, which the surfaces only refine
    """
    normals = surface.normals[np.abs(surface.normals).sum(axis=1) > 0]
    if len(normals) < _FEW:
        return None
    axes = [given] if given is not None else _candidates(normals)
    refined = [_refine_up(surface, axis) for axis in axes]
    planes = [_Planes.planes_across(surface, axis) for axis in refined]
    best = int(np.argmax([one.score for one in planes]))
    up, share = refined[best], planes[best].score
    if given is not None:
        return UpDirection(_snap_to_axis(up), True, share)
    evidence = planes[best].evidence_of_up(surface, up)
    sure = abs(evidence) > 1.0
    sign = np.sign(evidence if sure else up @ convention) or 1.0
    return UpDirection(_snap_to_axis(sign * up), sure, share)


def storey_height(surface: SurfacePoints, up: NDArray[np.float64]) -> float | None:
    """The usual distance from a floor to its ceiling along `up` (3,), in the unit of the surface; None if there are no
    two planes."""
    gaps = np.diff(_Planes.planes_across(surface, up).levels())
    return float(np.median(gaps[gaps > _STOREY * gaps.max()])) if len(gaps) else None


@dataclass(frozen=True, eq=False)
class _Planes:
    """The planes across an axis, without walls: columns along the axis that are full at most heights are walls.

    open     (M,) bool, the points that are not in walls
    heights  (N,) of these points along the axis
    bins     (B,) number of these points per height, each with its neighbors
    low      height of the first bin
    size     height of a bin
    total    number of all points
    """

    open: NDArray[np.bool_]
    heights: NDArray[np.float64]
    bins: NDArray[np.float64]
    low: float
    size: float
    total: int

    @staticmethod
    def planes_across(surface: SurfacePoints, axis: NDArray[np.float64]) -> _Planes:
        heights = surface.points @ axis
        low, high = (float(h) for h in np.percentile(heights, [1, 99]))
        span = max(high - low, 1e-9)
        side = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        side /= np.linalg.norm(side)
        across = surface.points @ np.stack([side, np.cross(axis, side)], axis=1)
        cells = np.floor((across - across.min(axis=0)) / (2 * surface.cell)).astype(np.int64)
        columns = np.unique(cells @ [1, 1 << 24], return_inverse=True)[1].reshape(-1)
        full = np.zeros((int(columns.max()) + 1, _HEIGHTS), bool)
        full[columns, np.clip(((heights - low) / span * _HEIGHTS).astype(np.int64), 0, _HEIGHTS - 1)] = True
        is_open = full.sum(axis=1)[columns] < _WALL
        heights = heights[is_open]
        size = max(span / 300, 0.7 * surface.cell)
        inside = heights[(heights > low - 4 * size) & (heights < high + 4 * size)]
        bins = np.bincount(((inside - low) / size + 4).astype(np.int64), minlength=9).astype(np.float64)
        smooth = np.convolve(bins, [1.0, 1.0, 1.0], "same")
        return _Planes(is_open, heights, smooth, low - 4 * size, size, len(surface.points))

    @property
    def score(self) -> float:
        """The root of the sum of the squared shares of all points that are in the largest planes."""
        total, bins = 0.0, self.bins.copy()
        for _ in range(_PLANES):
            peak = int(bins.argmax())
            total += (bins[peak] / self.total) ** 2
            bins[max(0, peak - 4) : peak + 5] = 0
        return float(np.sqrt(total))

    def levels(self) -> list[float]:
        """Heights of the large planes, ascending."""
        levels: list[float] = []
        for k in np.argsort(-self.bins, kind="stable"):
            z = self.low + (k + 0.5) * self.size
            if self.bins[k] > _LARGE * self.bins.max() and all(abs(z - other) > 8 * self.size for other in levels):
                levels.append(z)
        return sorted(levels)

    def evidence_of_up(self, surface: SurfacePoints, axis: NDArray[np.float64]) -> float:
        """How surely the axis points up: above 1 surely, below -1 surely down. It is the sum of two measures:
        horizontal surfaces in the lower half of the storeys, relative to the upper half, and the brightness of the
        ceilings, relative to the floors. Walls do not count, because lintels of doors are below the ceiling."""
        levels = self.levels()
        gaps = np.diff(levels)
        level = (np.abs(surface.normals @ axis) > _FLAT_ON_TOP)[self.open]
        bright, flat = surface.bright[self.open], self.heights[level]
        below = above = 0.0005 * self.total  # points that noise may add
        floors, ceilings = list[NDArray[np.float32]](), list[NDArray[np.float32]]()
        for floor, gap in zip(levels[:-1], gaps, strict=True):
            if gap >= _STOREY * gaps.max():
                at = (flat - floor) / gap
                below += float(((at > _BAND[0]) & (at < _BAND[1])).sum())
                above += float(((at > 1 - _BAND[1]) & (at < 1 - _BAND[0])).sum())
                at = (self.heights - floor) / gap
                near = max(_PLANE, self.size / gap)
                floors.append(bright[np.abs(at) < near])
                ceilings.append(bright[np.abs(at - 1) < near])
        if not floors:
            return 0.0
        brighter = float(np.concatenate(ceilings).mean() - np.concatenate(floors).mean())
        return float(np.log(below / above) / np.log(_RATIO)) + brighter / _BRIGHTER


def _candidates(normals: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Directions with the most normals around them, each the mean of these normals."""
    k = np.arange(_DIRECTIONS) + 0.5
    z, turn = 1 - k / _DIRECTIONS, np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    sample = normals[:: max(1, len(normals) // 20_000)]
    counts = np.zeros(_DIRECTIONS, np.int64)
    for first in range(0, len(sample), _CHUNK):
        counts += (np.abs(sample[first : first + _CHUNK] @ directions.T) > _CONE).sum(axis=0)
    found: list[NDArray[np.float64]] = []
    for index in np.argsort(-counts, kind="stable"):
        if all(abs(directions[index] @ other) < _APART for other in found):
            found.append(_mean_axis(sample, directions[index]))
        if len(found) == _CANDIDATES:
            break
    return found


def _mean_axis(normals: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    for _ in range(4):
        along = normals @ axis
        near = np.abs(along) > _CONE
        if near.sum() < 20:
            break
        mean = (normals[near] * np.sign(along[near])[:, None]).sum(axis=0)
        axis = mean / np.linalg.norm(mean)
    return np.asarray(axis)


def _refine_up(surface: SurfacePoints, axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """The common normal of the large planes across an axis, if it is near the axis."""
    up = axis
    for tolerance in (4.0, 3.0, 2.0, 1.5):
        planes = _Planes.planes_across(surface, up)
        spread, points = np.zeros((3, 3)), surface.points[planes.open]
        for level in planes.levels():
            near = points[np.abs(planes.heights - level) < tolerance * planes.size]
            if len(near) >= _FEW:
                centered = near - near.mean(axis=0)
                spread += centered.T @ centered
        if not spread.any():
            return axis
        normal = np.linalg.eigh(spread)[1][:, 0]
        normal *= np.sign(normal @ up)
        if normal @ axis < _GIVEN:
            return axis
        up = normal
    return np.asarray(up)


def _snap_to_axis(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """`up`, or the axis of the file that is within half a degree of it."""
    k = int(np.argmax(np.abs(up)))
    axis = np.zeros(3)
    axis[k] = np.sign(up[k])
    return axis if np.degrees(np.arccos(min(1.0, abs(float(up[k]))))) < _SNAP else up / np.linalg.norm(up)
