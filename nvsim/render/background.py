"""The background of a submap model at every pixel: SH of the direction, plus the floor texture where the ray meets the
floor (paper section III-C; the texture is ours)."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numba import njit, prange

from nvsim.geometry.camera import Camera
from nvsim.render.floor_texture import (
    distance_to_floor,
    footprint_of,
    pack_floor,
    pack_texture,
    texture_colour,
)
from nvsim.render.layout import TILE
from nvsim.render.projection import pack, sh_terms
from nvsim.render.types import Float32
from nvsim.render.workspace import LOCK
from nvsim.splats.types import SubmapModel

_F = np.float32
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)
_DARK = _F(1 / 1024)  # a background dimmed by more than this cannot be seen in 8 bits


@njit(fastmath=True, error_model="numpy")
def _sky_segment(view: Any, coefficients: Any, x0: Any, y: Any, planes: Any) -> None:
    # 16 pixels at a time: directions to planes 0 to 2 and the forward component to plane 3, colours to planes 4 to 6.
    v = (_F(y) + _HALF - view[15]) / view[13]
    for i in range(TILE):
        u = (_F(x0 + i) + _HALF - view[14]) / view[12]
        n = _ONE / math.sqrt(u * u + v * v + _ONE)
        dx = (view[0] * u + view[3] * v + view[6]) * n
        dy = (view[1] * u + view[4] * v + view[7]) * n
        dz = (view[2] * u + view[5] * v + view[8]) * n
        planes[i], planes[TILE + i], planes[2 * TILE + i], planes[3 * TILE + i] = dx, dy, dz, n
        values = sh_terms(dx, dy, dz)
        red = green = blue = _ZERO
        for k in range(25):
            red += coefficients[k, 0] * values[k]
            green += coefficients[k, 1] * values[k]
            blue += coefficients[k, 2] * values[k]
        planes[4 * TILE + i], planes[5 * TILE + i], planes[6 * TILE + i] = red, green, blue


@njit(fastmath=True, error_model="numpy")
def _paint_row(
    view: Any,
    coefficients: Any,
    heights: Any,
    grid: Any,
    texels: Any,
    table: Any,
    sizes: Any,
    bounds: Any,
    y: Any,
    transmittance: Any,
    rgb: Any,
    planes: Any,
) -> None:
    width = transmittance.shape[0]
    textured = table.shape[0] > 0
    for x0 in range(0, width, TILE):
        count = min(TILE, width - x0)
        lightest = _ZERO
        for i in range(count):
            lightest = max(lightest, transmittance[x0 + i])
        if lightest < _DARK:
            continue
        _sky_segment(view, coefficients, x0, y, planes)
        for i in range(count):
            through = transmittance[x0 + i]
            if through < _DARK:
                continue
            red, green, blue = planes[4 * TILE + i], planes[5 * TILE + i], planes[6 * TILE + i]
            if textured:
                dx, dy, dz = planes[i], planes[TILE + i], planes[2 * TILE + i]
                distance = distance_to_floor(heights, grid, view[22], view[23], view[24], dx, dy, dz)
                if distance > _ZERO:
                    footprint = footprint_of(distance, planes[3 * TILE + i], dz, view[12])
                    x, y_ = view[22] + distance * dx, view[23] + distance * dy
                    r, g, b = texture_colour(texels, table, sizes, bounds, x, y_, footprint)
                    red, green, blue = red + r, green + g, blue + b
            rgb[x0 + i, 0] += through * red
            rgb[x0 + i, 1] += through * green
            rgb[x0 + i, 2] += through * blue


@njit(parallel=True, cache=True)
def paint(
    view: Any,
    coefficients: Any,
    heights: Any,
    grid: Any,
    texels: Any,
    table: Any,
    sizes: Any,
    bounds: Any,
    threads: Any,
    transmittance: Any,
    rgb: Any,
) -> None:
    """Adds transmittance (H, W) * background to rgb (H, W, 3). `view` from projection.pack, `coefficients` (25, 3),
    the rest from floor_texture."""
    for thread in prange(threads):
        planes = np.empty(7 * TILE, np.float32)
        for y in range(thread, rgb.shape[0], threads):
            _paint_row(
                view,
                coefficients,
                heights,
                grid,
                texels,
                table,
                sizes,
                bounds,
                y,
                transmittance[y],
                rgb[y],
                planes,
            )


def paint_background(model: SubmapModel, camera: Camera, transmittance: Float32, rgb: Float32) -> None:
    """Adds the background of `model`, dimmed by transmittance (H, W), to rgb (H, W, 3) in place. Where less than
    1/1024 comes through, it is left out."""
    if model.background is None and model.texture is None:
        return
    coefficients = np.zeros((25, 3), np.float32)
    if model.background is not None:
        coefficients = np.require(model.background.coefficients(camera.position), np.float32, ["C", "A", "W"])
    heights, grid = pack_floor(model.floor)
    t = pack_texture(model.texture)
    with LOCK:
        paint(
            pack(camera, model.antialiased),
            coefficients,
            heights,
            grid,
            t.texels,
            t.table,
            t.sizes,
            t.bounds,
            numba.get_num_threads(),
            transmittance,
            rgb,
        )


def render_background(model: SubmapModel, camera: Camera) -> Float32:
    """(H, W, 3) float32, not clamped: what the model shows where there are no Gaussians; zeros without background and
    texture."""
    k = camera.intrinsics
    rgb = np.zeros((k.height, k.width, 3), np.float32)
    paint_background(model, camera, np.ones((k.height, k.width), np.float32), rgb)
    return rgb
