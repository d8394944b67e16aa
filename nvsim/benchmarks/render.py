"""Measures the parts of rendering a view of many Gaussians, and the share of the machine's peak that kernels reach."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.kernels import njit, prange
from nvsim.render.ellipse_extent import pixel_rows
from nvsim.render.kernel_types import TILE, Float32, Int32, Int64, Whole
from nvsim.render.model import render_gaussians
from nvsim.render.workspace import RenderBuffers, as_kernel_array
from nvsim.splats.types import Gaussians

_F = np.float32
_STEPS, _LANES, _ROUNDS = 32, 2048, 4000


@njit(parallel=True, fastmath=True)
def _horner(
    threads: int,
    rounds: int,
    out: Float32,  # (threads, _LANES) changed
) -> None:
    # A polynomial of degree 32 in each lane, so that nearly all instructions are multiply-adds.
    for thread in prange(threads):
        values = out[thread]
        for r in range(rounds):
            shift = _F(r) * _F(1e-7)
            for i in range(_LANES):
                x = values[i] * _F(0.5) + shift
                p = x
                for _ in range(_STEPS):
                    p = p * x + _F(0.25)
                values[i] = p


def multiply_adds_per_second() -> float:
    """Multiply-adds per second of a vectorized loop with all threads of numba. Returns the best of five runs
    of about a quarter of a second each."""
    threads = numba.get_num_threads()
    values = np.full((threads, _LANES), 0.1, np.float32)
    _horner(threads, 1, values)
    best = 0.0
    for _ in range(5):
        started = time.perf_counter()
        _horner(threads, _ROUNDS, values)
        seconds = time.perf_counter() - started
        best = max(best, threads * _ROUNDS * _LANES * (_STEPS + 1) / seconds)
    return best


EYE, TARGET, FIELD_OF_VIEW = (1.8, 1.6, 1.6), (6.0, 4.8, 1.0), np.radians(70)
"""The fixed view into a room with a corner at the origin: positions in meters, horizontal field of view in radians."""
LANE_WORK = 16
"""Multiplications, additions and multiply-adds per lane in the forward raster loop, including the exponential."""
TURN = 0.01
"""Radians by which the moving camera turns between frames."""


def inside_view(width: int, height: int) -> Camera:
    """The level camera at EYE toward TARGET, with the principal point in the center."""
    return Camera(Intrinsics.from_fov(width, height, FIELD_OF_VIEW), _pose(0.0))


def measure(gaussians: Gaussians, camera: Camera, antialiased: bool = True, rounds: int = 15) -> dict[str, Any]:
    """Medians over `rounds`, in milliseconds:

    project_ms, sort_ms, raster_ms   projection to splats, sorting into tiles by depth, color and alpha
    forward_ms                       their sum
    raster_geometry_ms               as raster_ms, with depth and normals
    raster_backward_ms               from the gradient of the images to that of the 2D parameters of splats
    backward_ms                      down to the gradient of the raw parameters, including harmonics
    frame_ms                         a complete call for color and alpha with a turning camera
    visible, intersections           Gaussians drawn, pairs of a Gaussian and a tile that it touches
    gigaflops, peak_gigaflops, share multiply-adds per second of the forward raster loop, the machine's, and their ratio
    """
    g = gaussians
    arrays = Gaussians(*map(as_kernel_array, g.arrays))
    gradients = Gaussians(*map(np.empty_like, g.arrays))
    size = camera.intrinsics
    height, width = size.height, size.width
    rng = np.random.default_rng(0)
    d_rgb = rng.normal(size=(height, width, 3)).astype(np.float32)
    zeros, statistics_of = np.zeros((height, width), np.float32), np.zeros((len(g), 3), np.float32)
    workspace = RenderBuffers()
    through = [zeros]
    frames = iter(turn_camera_stepwise(camera, rounds + 1))

    def draw(geometry: bool) -> None:
        through[0] = workspace.draw(height, width, geometry)[1]

    parts: dict[str, Callable[[], object]] = {
        "project": lambda: workspace.project(arrays, camera, antialiased),
        "sort": workspace.bin,
        "raster_geometry": lambda: draw(True),
        "raster": lambda: draw(False),
        "raster_backward": lambda: workspace.draw_gradient(through[0], d_rgb, zeros, zeros),
        "project_backward": lambda: workspace.project_gradient(arrays, gradients, statistics_of),
        "frame": lambda: render_gaussians(arrays, next(frames), antialiased=antialiased),
    }
    times: dict[str, list[float]] = {name: [] for name in parts}
    for _ in range(rounds + 1):
        for name, part in parts.items():
            started = time.perf_counter()
            part()
            times[name].append(1e3 * (time.perf_counter() - started))
    ms = {name: statistics.median(values[1:]) for name, values in times.items()}
    lanes = _lanes(*workspace.drawn_entries)
    reached, peak = LANE_WORK * lanes / (1e-3 * ms["raster"]), multiply_adds_per_second()
    figures = {
        "project_ms": ms["project"],
        "sort_ms": ms["sort"],
        "raster_ms": ms["raster"],
        "forward_ms": ms["project"] + ms["sort"] + ms["raster"],
        "raster_geometry_ms": ms["raster_geometry"],
        "raster_backward_ms": ms["raster_backward"],
        "backward_ms": ms["raster_backward"] + ms["project_backward"],
        "frame_ms": ms["frame"],
    }
    return {
        **{name: round(value, 2) for name, value in figures.items()},
        "backend": "numba",
        "gaussians": len(g),
        "sh_degree": g.sh_degree,
        "size": f"{width}x{height}",
        "threads": numba.get_num_threads(),
        "antialiased": antialiased,
        "visible": workspace.visible,
        "intersections": workspace.intersections,
        "gigaflops": round(reached / 1e9, 1),
        "peak_gigaflops": round(peak / 1e9, 1),
        "share": round(reached / peak, 3),
    }


@njit(error_model="numpy")
def _lanes(
    splats: Float32,  # as RenderBuffers.drawn_entries, like those that follow
    order: Int32,
    offsets: Int64,
    last: Int64,
    columns: int,
) -> Whole:
    # Each touched row of a tile costs a complete row of lanes.
    rows: Whole = 0
    for tile in range(last.shape[0]):
        top = (tile // columns) * TILE
        for k in range(offsets[tile], last[tile]):
            low, high = pixel_rows(splats[order[k]], top)
            rows += high - low
    return rows * TILE


def turn_camera_stepwise(camera: Camera, count: int) -> list[Camera]:
    """`count` cameras, each turned by TURN about the vertical axis relative to the previous one."""
    return [Camera(camera.intrinsics, _turn_camera(camera, k * TURN)) for k in range(count)]


def _pose(turn: float) -> NDArray[np.float64]:
    ahead = np.subtract(TARGET, EYE)
    elevation = np.arctan2(ahead[2], np.hypot(ahead[0], ahead[1]))
    return camera_pose(np.array(EYE), float(np.arctan2(ahead[0], ahead[1])) + turn, float(elevation))


def _turn_camera(camera: Camera, angle: float) -> NDArray[np.float64]:
    pose = camera.camera_to_world.copy()
    c, s = np.cos(angle), np.sin(angle)
    pose[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ pose[:3, :3]
    return pose
