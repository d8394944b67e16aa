"""The background of a submap model at every pixel: SH of the direction, plus the floor texture if the ray meets the
floor. The SH are from paper section III-C; the texture is not in the paper."""

from __future__ import annotations

import math

import numba
import numpy as np
from numba import njit, prange

from nvsim.geometry.camera import Camera
from nvsim.render.floor_texture import (
    distance_to_floor,
    footprint_of,
    pack_floor,
    pack_texture,
    texture_color,
)
from nvsim.render.kernel_types import Float32, Int64, pack
from nvsim.render.sh_polynomials import COEFFICIENTS, change_of_basis, row_numbers
from nvsim.render.workspace import LOCK
from nvsim.splats.types import SubmapModel

_F = np.float32
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)
_SEGMENT = 64
_COLOR, _PLANES = 4, 7  # after the direction and its forward component
_DARK = _F(1 / 1024)  # a background dimmed by more than this is invisible in 8 bits


@njit(fastmath=True, error_model="numpy")
def _sky_segment(
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    terms: Float32,  # (25, 3) the coefficients after `change_of_basis`
    x0: int,  # first column of the segment
    count: int,  # pixels, at most _SEGMENT
    y: int,  # row
    planes: Float32,  # (_PLANES, _SEGMENT) out: direction (3), its forward component, color (3)
) -> None:
    # `count` pixels from x0 on: unit directions, world, and their forward component, then colors (see
    # `sh_polynomials`).
    v = (_F(y) + _HALF - view[15]) / view[13]
    for i in range(count):
        u = (_F(x0 + i) + _HALF - view[14]) / view[12]
        n = _ONE / math.sqrt(u * u + v * v + _ONE)
        planes[0, i] = (view[0] * u + view[3] * v + view[6]) * n
        planes[1, i] = (view[1] * u + view[4] * v + view[7]) * n
        planes[2, i] = (view[2] * u + view[5] * v + view[8]) * n
        planes[3, i] = n
    for channel in range(3):
        e0, e1, e2, e3, e4, o0, o1, o2, o3 = row_numbers(terms, v, channel)
        line, forward = planes[_COLOR + channel], planes[3]
        for i in range(count):
            u, n = (_F(x0 + i) + _HALF - view[14]) / view[12], forward[i]
            even = e0 + u * (e1 + u * (e2 + u * (e3 + u * e4)))
            odd = o0 + u * (o1 + u * (o2 + u * o3))
            line[i] = n * n * n * (n * even + odd)


@njit(fastmath=True, error_model="numpy")
def _paint_row(
    view: Float32,  # as in `paint`, like all following up to `bounds`
    terms: Float32,
    heights: Float32,
    grid: Float32,
    texels: Float32,
    table: Int64,
    sizes: Float32,
    bounds: Float32,
    y: int,  # row
    transmittance: Float32,  # (W,) of the row
    rgb: Float32,  # (W, 3) of the row, changed
    planes: Float32,  # (_PLANES, _SEGMENT) scratch
) -> None:
    width = transmittance.shape[0]
    textured = table.shape[0] > 0
    for x0 in range(0, width, _SEGMENT):
        count = min(_SEGMENT, width - x0)
        lightest = _ZERO
        for i in range(count):
            lightest = max(lightest, transmittance[x0 + i])
        if lightest < _DARK:
            continue
        _sky_segment(view, terms, x0, count, y, planes)
        for i in range(count):
            through = transmittance[x0 + i]
            if through < _DARK:
                continue
            red, green, blue = planes[_COLOR, i], planes[_COLOR + 1, i], planes[_COLOR + 2, i]
            if textured:
                dx, dy, dz = planes[0, i], planes[1, i], planes[2, i]
                distance = distance_to_floor(heights, grid, view[22], view[23], view[24], dx, dy, dz)
                if distance > _ZERO:
                    footprint = footprint_of(distance, planes[3, i], dz, view[12])
                    x, y_ = view[22] + distance * dx, view[23] + distance * dy
                    r, g, b = texture_color(texels, table, sizes, bounds, x, y_, footprint)
                    red, green, blue = red + r, green + g, blue + b
            rgb[x0 + i, 0] += through * red
            rgb[x0 + i, 1] += through * green
            rgb[x0 + i, 2] += through * blue


@njit(parallel=True, cache=True, nogil=True)
def paint(
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    terms: Float32,  # (25, 3) the background's coefficients after `change_of_basis`
    heights: Float32,  # (rows, columns) of the floor surface, meters, world z
    grid: Float32,  # (3,) of the floor surface: origin x and y and the spacing, meters, world
    texels: Float32,  # (n, 3) colors, all levels in one array
    table: Int64,  # (levels, 3) first texel, rows, columns; (0, 3) without a texture
    sizes: Float32,  # (levels,) texel size, meters
    bounds: Float32,  # (4,) low x, low y, high x, high y, meters, world
    threads: int,  # number of tasks that share the rows
    transmittance: Float32,  # (H, W) 0 to 1
    rgb: Float32,  # (H, W, 3) changed
) -> None:
    """Adds transmittance (H, W) * background to rgb (H, W, 3): harmonics of the direction, and the floor texture if the
    ray meets the floor."""
    for thread in prange(threads):
        planes = np.empty((_PLANES, _SEGMENT), np.float32)
        for y in range(thread, rgb.shape[0], threads):
            _paint_row(
                view,
                terms,
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
    """Adds the background of `model`, dimmed by transmittance (H, W), to rgb (H, W, 3) in place. Pixels with a
    transmittance below 1/1024 are skipped."""
    if model.background is None and model.texture is None:
        return
    terms = np.zeros((COEFFICIENTS, 3), np.float32)
    if model.background is not None:
        terms[:] = change_of_basis(camera.rotation) @ model.background.coefficients(camera.position)
    heights, grid = pack_floor(model.floor)
    t = pack_texture(model.texture)
    with LOCK:
        paint(
            pack(camera, model.antialiased),
            terms,
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
