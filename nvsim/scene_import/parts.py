"""Divide a scene into the submaps of a project: one per storey, and one per stair between two storeys."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.perception.floor_height import stair_floor
from nvsim.scene_import.levels import Storeys
from nvsim.scene_import.stairs import find_stairs
from nvsim.scene_import.surface_points import SurfacePoints
from nvsim.splats.types import Gaussians

_OVERLAP = 2.0  # meters above and below a storey that belong to its model, for views of stairs
_BESIDE = 6.0  # meters around a stair that belong to its model
_OFF = 0.3  # meters from the height of a storey at which a place is on a stair


@dataclass(frozen=True, eq=False)
class Part:
    """A storey, or a stair.

    storeys    the storey, or the two storeys that a stair joins, numbered from 0
    rows       indices of its places among all places of the scene
    surface    its floor
    gaussians  its model
    """

    storeys: tuple[int, ...]
    rows: tuple[int, ...]
    surface: FloorSurface
    gaussians: Gaussians


def divide(
    gaussians: Gaussians, surface: SurfacePoints, storeys: Storeys, height: float
) -> tuple[tuple[Part, ...], NDArray[np.float64]]:
    """The parts of a scene, lowest first, and the places (N, 3) meters of viewpoints `height` meters above the floor:
    those of each storey, then those along each stair."""
    levels = storeys.levels
    stairs = [find_stairs(surface, lower, upper) for lower, upper in zip(levels[:-1], levels[1:], strict=True)]
    groups = [level.places for level in levels] + stairs
    firsts = np.cumsum([0, *map(len, groups)])
    places = np.concatenate(groups) + [0.0, 0.0, height]
    rows = [list(range(firsts[k], firsts[k + 1])) for k in range(len(groups))]
    floors = [level.height for level in levels]
    parts: list[Part] = []
    for k, level in enumerate(levels):
        low = -np.inf if k == 0 else floors[k] - _OVERLAP
        high = np.inf if k + 1 == len(floors) else floors[k + 1] + _OVERLAP
        z = gaussians.means[:, 2]
        parts.append(Part((k,), (), level.surface, chosen(gaussians, (z >= low) & (z <= high))))
        if k < len(stairs) and len(stairs[k]):
            own = rows[len(levels) + k]
            steps = [i for i in own if floors[k] + _OFF < places[i, 2] - height < floors[k + 1] - _OFF]
            rows[k] += [i for i in own if places[i, 2] - height <= floors[k] + _OFF]
            rows[k + 1] += [i for i in own if places[i, 2] - height >= floors[k + 1] - _OFF]
            if steps:
                slope = stair_floor(places[own], height)
                near = _is_near(gaussians, stairs[k], floors[k] - _OVERLAP, floors[k + 1] + _OVERLAP)
                parts.append(Part((k, k + 1), tuple(steps), slope, chosen(gaussians, near)))
    return tuple(
        Part(p.storeys, p.rows or tuple(sorted(rows[p.storeys[0]])), p.surface, p.gaussians) for p in parts
    ), places


def chosen(g: Gaussians, rows: NDArray[np.bool_]) -> Gaussians:
    """The Gaussians with `rows` (N,) bool."""
    if rows.all():
        return g
    return Gaussians(g.means[rows], g.log_scales[rows], g.quats[rows], g.opacity_logits[rows], g.sh[rows])


def _is_near(g: Gaussians, path: NDArray[np.float64], low: float, high: float) -> NDArray[np.bool_]:
    corners = path[:, :2].min(axis=0) - _BESIDE, path[:, :2].max(axis=0) + _BESIDE
    inside = ((g.means[:, :2] >= corners[0]) & (g.means[:, :2] <= corners[1])).all(axis=1)
    return np.asarray(inside & (g.means[:, 2] >= low) & (g.means[:, 2] <= high))
