"""Measures an OpenGL frame and its parts, and compares it with a frame of the kernels; milliseconds."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.model import render_model
from nvsim.render.opengl.renderer import OpenGLRenderer
from nvsim.splats.types import Background, FloorTexture, Gaussians, SubmapModel

_SIZES = {"embed.0": (32, 27), "trunk.0": (64, 32), "base": (3, 64), "rest": (72, 64)}
_TEXELS = (0.4, 0.1, 0.03)  # meters, of the levels of the floor texture
_PARTS = ("project", "sort", "upload", "draw", "frame")
MOVING_SECONDS = 2.0
TURN = 0.01
"""Radians by which the moving camera turns per frame."""


def with_floor_and_background(gaussians: Gaussians, antialiased: bool = True) -> SubmapModel:
    """Adds the other parts of a trained submap to Gaussians: a background network, an uneven floor below them, and a
    floor texture of three levels. A frame of a splat file then includes all work."""
    r, f = np.random.default_rng(0), np.float32
    low, high = gaussians.means.min(axis=0), gaussians.means.max(axis=0)
    width, depth = np.maximum(high - low, 1.0)[:2]
    weights = {f"{n}.weight": (0.5 * r.normal(size=s) / np.sqrt(s[1])).astype(f) for n, s in _SIZES.items()}
    weights |= {f"{n}.bias": np.zeros(s[0], f) for n, s in _SIZES.items()}
    weights["base.bias"] += f(1.5)
    levels = tuple(r.normal(0, 0.05, (int(depth / t) + 1, int(width / t) + 1, 3)).astype(f) for t in _TEXELS)
    heights = low[2] + r.normal(0, 0.01, (int(depth) + 2, int(width) + 2))
    corner = (float(low[0]), float(low[1]))
    texture = FloorTexture(levels, corner, (corner[0] + float(width), corner[1] + float(depth)))
    floor = FloorSurface(heights.astype(f), corner, 1.0)
    return SubmapModel(gaussians, Background(weights), texture, floor, antialiased)


def _moving(renderer: OpenGLRenderer, model: SubmapModel, camera: Camera, seconds: float) -> dict[str, float]:
    k = camera.intrinsics
    context = renderer.context
    with context:
        color = context.renderbuffer((k.width, k.height), 4)
        picture = context.framebuffer([color])
    drawn = new = 0
    before: Camera | None = None
    pose = camera.camera_to_world
    c, s = np.cos(TURN), np.sin(TURN)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    try:
        with context:
            started = time.perf_counter()
            while (passed := time.perf_counter() - started) < seconds:
                pose = pose.copy()
                pose[:3, :3] = turn @ pose[:3, :3]
                shown = renderer.draw(model, Camera(k, pose), picture)
                context.finish()
                drawn += 1
                new += shown is not before
                before = shown
            renderer.wait_until_ready()
    finally:
        with context:
            picture.release()
            color.release()
    return {"fps": round(drawn / passed, 1), "new_fps": round(new / passed, 1)}


def measure(model: SubmapModel, camera: Camera, rounds: int = 15) -> dict[str, Any]:
    """Medians over `rounds` frames of both renderers in turns, each prepared anew and read back as 8-bit colors.

    frame_ms      the whole frame. Its parts are project_ms, sort_ms (with writing the quads), upload_ms to the GPU, and
                  draw_ms: both passes and reading the image back
    cpu_frame_ms  the frame by the kernels
    psnr_db       between the two images; rounding to 8 bits alone gives 58.9
    fps           frames per second into a buffer that stays on the GPU, as in a window, while the camera turns
    new_fps       those of them with another camera than the previous frame, because frames are prepared in parallel
    renderer      the name that the driver reports

    Raises InputError if OpenGL 3.3 is not available.
    """
    times: dict[str, list[float]] = {name: [] for name in (*_PARTS, "cpu_frame")}
    channels = frozenset({"rgb"})
    with OpenGLRenderer() as renderer:
        by_kernels = render_model(model, camera, channels, backend="numba").rgb
        assert by_kernels is not None  # the channel was requested
        error = renderer.render(model, camera) / 255 - np.clip(by_kernels, 0, 1)
        for _ in range(rounds):
            renderer.render(model, replace(camera))  # a new camera object with equal values, so that nothing is reused
            parts = renderer.milliseconds
            parts["draw"] = parts["frame"] - parts["project"] - parts["sort"] - parts["upload"]
            for name in _PARTS:
                times[name].append(parts[name])
            begin = time.perf_counter()
            render_model(model, camera, channels, backend="numba")
            times["cpu_frame"].append(1e3 * (time.perf_counter() - begin))
        name = renderer.name
        moving = _moving(renderer, model, camera, MOVING_SECONDS)
    k = camera.intrinsics
    return {
        **{f"{part}_ms": round(float(np.median(values)), 2) for part, values in times.items()},
        **moving,
        "psnr_db": round(float(-10 * np.log10(np.mean(error**2))), 2),
        "backend": "opengl",
        "renderer": name,
        "gaussians": len(model.gaussians),
        "size": [k.width, k.height],
    }
