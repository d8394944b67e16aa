"""Simulates the point cloud of a LiDAR carried along the trajectory: range noise, beams, few or no returns from
glass."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from nvsim.building.baking import Textures
from nvsim.building.raycast import trace
from nvsim.building.rendering import radiance
from nvsim.building.scene import CAMERA_HEIGHT, Scene
from nvsim.capture.types import Cloud

_RANGE, _NOISE, _GLASS_RETURNS = 12.0, 0.01, 0.04
_EVERY = 1.2  # meters of the trajectory between sweeps
_VOXEL = 0.045
_MOST, _USUAL_AREA = 340_000, 300.0  # greatest number of points of a storey with this many square meters
_AT_ONCE = 32  # sweeps that are merged at once


def scan(scene: Scene, textures: Textures, rng: np.random.Generator) -> Cloud:
    """One point per voxel, in an order that does not depend on the machine; coordinates in whole millimeters."""
    moved = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(scene.path[:, :2], axis=0), axis=1))])
    stands = scene.path[np.searchsorted(moved, np.arange(0.0, moved[-1], _EVERY))]
    places = stands[:, [0, 1, 3]] + np.array([0.0, 0.0, CAMERA_HEIGHT])
    # Glass is clean in a building of style "glass"; in the other styles it returns a few points.
    returns = 0.0 if scene.config.style == "glass" else _GLASS_RETURNS
    beams, turns = np.radians(np.linspace(-62, 48, 84)), 600
    merged, pending = _VoxelFilter(), []
    for k, place in enumerate(places):
        azimuth = np.radians(np.arange(turns) * 360 / turns + rng.uniform(0, 360 / turns))
        elevation = beams + np.radians(rng.uniform(-0.5, 0.5))
        ce, se = np.cos(elevation)[:, None], np.sin(elevation)[:, None]
        directions = np.stack(np.broadcast_arrays(ce * np.cos(azimuth), ce * np.sin(azimuth), se), axis=-1).reshape(
            -1, 3
        )
        chance = rng.random(len(directions), dtype=np.float32)
        ranges, rgb = _sweep(place, directions, chance, returns, scene.solids, textures)
        kept = ranges < _RANGE
        noisy = ranges[kept] + rng.normal(0, _NOISE, int(kept.sum()))
        pending.append((place + noisy[:, None] * directions[kept], rgb[kept]))
        if len(pending) == _AT_ONCE or k + 1 == len(places):
            merged.add(pending)
            pending = []
    most = _MOST * max(len(scene.storeys), round(scene.plan.extent.area / _USUAL_AREA))
    return merged.cloud(most, rng)


class _VoxelFilter:
    """Keeps the first point in each voxel."""

    def __init__(self) -> None:
        self._keys, self._order = np.empty(0, np.int64), np.empty(0, np.int64)
        self._points, self._colors = np.empty((0, 3)), np.empty((0, 3), np.uint8)
        self._count = 0

    def add(self, sweeps: list[tuple[NDArray[np.float64], NDArray[np.uint8]]]) -> None:
        points, colors = (np.concatenate(parts) for parts in zip(*sweeps, strict=True))
        cell = np.floor(points / _VOXEL).astype(np.int64) + 4096
        keys = np.concatenate([self._keys, (cell[:, 0] << 40) + (cell[:, 1] << 20) + cell[:, 2]])
        self._keys, first = np.unique(keys, return_index=True)
        order = np.concatenate([self._order, self._count + np.arange(len(points))])
        self._count += len(points)
        self._order = order[first]
        self._points = np.concatenate([self._points, points])[first]
        self._colors = np.concatenate([self._colors, colors])[first]

    def cloud(self, most: int, rng: np.random.Generator) -> Cloud:
        """All points in voxel order, or, if there are more than `most`, a random sample in the order of observation."""
        chosen = np.arange(len(self._keys))
        if len(chosen) > most:
            chosen = rng.permutation(chosen)[:most]
            chosen = chosen[np.argsort(self._order[chosen])]
        return Cloud(np.round(self._points[chosen], 3).astype(np.float32), self._colors[chosen])


@njit(cache=True, parallel=True, error_model="numpy")
def _sweep(origin, directions, chance, returns, solids, textures):  # type: ignore[no-untyped-def]
    count = directions.shape[0]
    ranges, colors = np.empty(count), np.empty((count, 3), np.uint8)
    nobody, bare = np.empty((0, 5)), np.empty((0, 3))
    for i in prange(count):
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        t, surface, glass = trace(origin[0], origin[1], origin[2], dx, dy, dz, solids, nobody)
        if glass < t and chance[i] < returns:
            ranges[i] = glass
            colors[i, 0], colors[i, 1], colors[i, 2] = 150, 160, 160
            continue
        ranges[i] = t
        x, y, z = origin[0] + t * dx, origin[1] + t * dy, origin[2] + t * dz
        r, g, b = radiance(x, y, z, dx, dy, dz, t, surface, 0.01, solids, textures, nobody, bare)
        colors[i, 0], colors[i, 1], colors[i, 2] = int(255 * r + 0.5), int(255 * g + 0.5), int(255 * b + 0.5)
    return ranges, colors
