"""Measures the speed of the map builder in a furnished hall of Gaussians that is generated in memory."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.render.backends import RenderOutput
from nvsim.splats.types import Gaussians, SubmapModel

HALL = (16.0, 12.0)  # meters
_HEIGHT = 2.6
_SPACING = 0.05  # meters between Gaussians on a surface


class _Hall:
    def __init__(self, model: SubmapModel) -> None:
        self._model = model

    def views(
        self, position: NDArray[np.floating], cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> tuple[int, list[RenderOutput]]:
        from nvsim.render.scene import render_regions

        return 0, render_regions(self._model, cameras, masks, frozenset({"alpha", "normal"}))


def measure(max_viewpoints: int = 60) -> dict[str, Any]:
    """viewpoints_per_s: viewpoints rendered, decided and joined per second, without compilation; also compile_s,
    viewpoints, edges, views_per_s, view_size and gaussians."""
    model = hall()
    source = _Hall(model)
    walk = np.stack([np.linspace(1.5, HALL[0] - 1.5, 40), np.full(40, 1.2), np.full(40, 1.3)], axis=-1)
    config = MappingConfig(max_viewpoints=max_viewpoints, max_distance=20.0)

    def floor_at(points: NDArray[np.floating]) -> NDArray[np.floating]:
        return model.floor.height_at(np.asarray(points))

    def support(points: NDArray[np.floating]) -> NDArray[np.bool_]:
        xy = points[..., :2]
        return np.asarray(((xy > 0) & (xy < np.array(HALL))).all(axis=-1))

    started = time.perf_counter()
    build_map(source, walk, floor_at, support, replace(config, max_viewpoints=1), scan="warm")
    compiled = time.perf_counter()
    report = build_map(source, walk, floor_at, support, config, scan="bench").report
    seconds = time.perf_counter() - compiled
    return {
        "viewpoints_per_s": round(report["rendered_viewpoints"] / seconds, 2),
        "views_per_s": round(report["rendered_views"] / seconds, 1),
        "viewpoints": report["viewpoints"],
        "edges": report["edges"],
        "gaussians": len(model.gaussians),
        "view_size": config.view_size,
        "compile_s": round(compiled - started, 2),
    }


def hall() -> SubmapModel:
    """The hall: walls and twelve desks, covered with flat opaque Gaussians; the floor has none."""
    (w, d), h = HALL, _HEIGHT
    parts = [panel((0, 0), (w, 0), h), panel((0, d), (w, d), h), panel((0, 0), (0, d), h), panel((w, 0), (w, d), h)]
    for x in (3.0, 6.5, 10.0, 13.5):
        for y in (3.0, 6.0, 9.0):
            a, b = (x - 0.6, y - 0.4), (x + 0.6, y + 0.4)
            corners = [a, (b[0], a[1]), b, (a[0], b[1])]
            parts += [panel(p, q, 0.75) for p, q in zip(corners, corners[1:] + corners[:1])]
    means = np.concatenate([p[0] for p in parts]).astype(np.float32)
    quats = np.concatenate([p[1] for p in parts]).astype(np.float32)
    count = len(means)
    scales = np.full((count, 3), np.log(0.6 * _SPACING), np.float32)
    scales[:, 2] = np.log(0.004)  # the shortest axis becomes the normal of the panel
    sh = np.random.default_rng(0).uniform(-0.5, 0.5, (count, 1, 3)).astype(np.float32)
    gaussians = Gaussians(means, scales, quats, np.full(count, 4.0, np.float32), sh)
    return SubmapModel(gaussians, None, None, FloorSurface.flat(0.0))


def panel(
    a: tuple[float, float], b: tuple[float, float], height: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centers (N, 3) in meters and quaternions (N, 4) of Gaussians on a vertical panel from a to b, in a regular
    grid."""
    along = np.array(b) - np.array(a)
    length = float(np.hypot(*along))
    s = (np.arange(max(1, round(length / _SPACING))) + 0.5) * _SPACING / length
    z = (np.arange(max(1, round(height / _SPACING))) + 0.5) * _SPACING
    xy = np.array(a) + s[:, None] * along
    points = np.concatenate([np.repeat(xy, len(z), axis=0), np.tile(z, len(s))[:, None]], axis=1)
    # Rotates the z axis onto the panel's normal: a quarter turn about the panel's horizontal direction.
    direction = along / length
    half = np.sqrt(0.5)
    quat = np.array([half, half * direction[0], half * direction[1], 0.0])
    return points, np.tile(quat, (len(points), 1))
