"""Models in memory for the tests of the OpenGL renderer: everything that a trained submap can have."""

from __future__ import annotations

import numpy as np

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.types import Background, FloorTexture, Gaussians, SubmapModel

CAMERA = Camera(Intrinsics(161, 119, 110.0, 117.0, 74.0, 65.0), camera_pose(np.array([3.0, 2.0, 1.4]), 0.7, -0.35))


def room(count: int = 4000, seed: int = 5, floating: float = 1.0) -> Gaussians:
    """Gaussians of many shapes in a room of 6 x 5 x 2.5 m, that let about half of the light through."""
    r = np.random.default_rng(seed)
    means = r.random((count, 3)) * [6, 5, 2.5]
    log_scales = np.log(r.uniform(0.004, 0.08, (count, 3)) * floating)
    return Gaussians(
        *(
            np.ascontiguousarray(a, np.float32)
            for a in (
                means,
                log_scales,
                r.normal(size=(count, 4)),
                r.normal(0, 2, count),
                r.normal(0, 0.4, (count, 16, 3)),
            )
        )
    )


def background(seed: int = 0) -> Background:
    r = np.random.default_rng(seed)
    layers = {"embed.0": (16, 27), "trunk.0": (20, 16), "base": (3, 20), "rest": (72, 20)}
    weights = {}
    for name, (out, inputs) in layers.items():
        weights[f"{name}.weight"] = (0.5 * r.normal(size=(out, inputs)) / np.sqrt(inputs)).astype(np.float32)
        weights[f"{name}.bias"] = r.normal(0, 0.1, out).astype(np.float32)
    weights["base.bias"] += np.float32(1.6)
    return Background(weights)


def texture(seed: int = 1) -> FloorTexture:
    r = np.random.default_rng(seed)
    sizes = ((5, 7), (21, 26), (82, 103))
    levels = tuple(r.normal(0, 0.1, (*size, 3)).astype(np.float32) for size in sizes)
    return FloorTexture(levels, (0.3, 0.2), (5.9, 4.8))


def stairs() -> FloorSurface:
    """Two levels 0.5 m apart, a ramp between them along x, and a step along y."""
    x = np.clip((np.arange(13) * 0.5 - 2.5) / 1.5, 0, 1) * 0.5
    heights = np.repeat(x[None], 11, axis=0)
    heights[7:] += 0.17
    return FloorSurface(heights.astype(np.float32), (0.0, 0.0), 0.5)


MODELS = {
    "splats alone": SubmapModel(room(), None, None, FloorSurface.flat(0.0)),
    "classic": SubmapModel(room(), None, None, FloorSurface.flat(0.0), antialiased=False),
    "background": SubmapModel(room(600), background(), None, FloorSurface.flat(0.0)),
    "flat floor": SubmapModel(room(600), background(), texture(), FloorSurface.flat(0.05)),
    "stairs and ramp": SubmapModel(room(600), background(), texture(), stairs()),
    "floor without background": SubmapModel(room(600), None, texture(), stairs()),
    "no Gaussians": SubmapModel(Gaussians.empty(3), background(), texture(), stairs()),
}
