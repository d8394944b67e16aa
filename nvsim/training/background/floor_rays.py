"""Intersections of all rays of a view with the floor. This is the renderer's rule for one ray (`render.floor_texture`),
applied to one segment of a row at a time, in loops without branches that LLVM vectorizes."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from nvsim.render.arithmetic import FLAGS
from nvsim.render.floor_texture import CLOSE, FLATTEST, ITERATIONS, height_at

DARK = np.float32(1 / 1024)
"""Light that is invisible in 8 bits."""
Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]
_F = np.float32
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)
_SEGMENT = 64
_DX, _DY, _DZ, _FORWARD, _DISTANCE, _PLANES = 0, _SEGMENT, 2 * _SEGMENT, 3 * _SEGMENT, 4 * _SEGMENT, 5 * _SEGMENT


@njit(fastmath=FLAGS, error_model="numpy")
def _directions(
    camera: Float32,  # (16,) `pack_camera`
    v: np.float32,  # y of the row over z, in the camera frame
    x0: int,  # first column of the segment
    drop: np.float32,  # meters from the camera up to the floor, so below zero
    planes: Float32,  # (_PLANES,) out
) -> None:
    # Unit directions, their forward component, and the distance to a level floor at height `drop` relative to the
    # camera. A ray that does not point down gets a substitute direction and the distance -1.
    step, first = _ONE / camera[12], (_F(x0) + _HALF - camera[14]) / camera[12]
    a, b, c = camera[0], camera[3], camera[6]
    ahead_x, ahead_y, ahead_z = camera[1] * v + camera[2], camera[4] * v + camera[5], camera[7] * v + camera[8]
    above = v * v + _ONE
    for i in range(_SEGMENT):
        u = _F(i) * step + first
        forward = _ONE / np.sqrt(u * u + above)
        dz = (c * u + ahead_z) * forward
        met = dz < FLATTEST
        dz = dz if met else -_ONE
        planes[_DX + i], planes[_DY + i], planes[_DZ + i] = (a * u + ahead_x) * forward, (b * u + ahead_y) * forward, dz
        planes[_FORWARD + i] = forward
        planes[_DISTANCE + i] = drop / dz if met else -_ONE


@njit(fastmath=FLAGS, error_model="numpy")
def _approach(
    heights: Float32,  # (rows, columns) meters, world z
    grid: Float32,  # (3,) origin x and y and the spacing, meters
    eye_x: np.float32,  # meters, world, as the next two
    eye_y: np.float32,
    eye_z: np.float32,
    planes: Float32,  # (_PLANES,) of `_directions`; the distances change
) -> None:
    # The fixed-point iteration of `distance_to_floor`, until no ray of the segment moves.
    rows, columns = heights.shape
    flat = heights.reshape(-1)
    start_x, start_y, per_meter = grid[0], grid[1], _ONE / grid[2]
    last_column, last_row = _F(columns - 1), _F(rows - 1)
    wide, high = np.int32(columns), np.int32(rows)
    one = np.int32(1)
    for _ in range(ITERATIONS):
        moved = np.int32(0)
        for i in range(_SEGMENT):
            before, dz = planes[_DISTANCE + i], planes[_DZ + i]
            x, y = eye_x + before * planes[_DX + i], eye_y + before * planes[_DY + i]
            c = min(max((x - start_x) * per_meter, _ZERO), last_column)
            r = min(max((y - start_y) * per_meter, _ZERO), last_row)
            c0, r0 = np.int32(c), np.int32(r)
            c1, r1 = min(c0 + one, wide - one), min(r0 + one, high - one)
            fc, fr = c - _F(c0), r - _F(r0)
            h00, h01 = flat[np.uint32(r0 * wide + c0)], flat[np.uint32(r0 * wide + c1)]
            h10, h11 = flat[np.uint32(r1 * wide + c0)], flat[np.uint32(r1 * wide + c1)]
            low, up = h00 + fc * (h01 - h00), h10 + fc * (h11 - h10)
            distance = (low + fr * (up - low) - eye_z) / dz
            met = before != -_ONE
            moved += np.int32(met & (abs(distance - before) >= CLOSE))
            planes[_DISTANCE + i] = distance if met else -_ONE
        if moved == 0:
            break


@njit(parallel=True, cache=True, fastmath=FLAGS, error_model="numpy")
def meet_floor(
    camera: Float32,  # (16,) `pack_camera`
    heights: Float32,  # (rows, columns) of the floor surface, meters, world z
    grid: Float32,  # (3,) of the floor surface: origin x and y and the spacing, meters, world
    floor: Mask,  # (H, W) pixels that are always requested
    transmittance: Float32,  # (H, W) 0 to 1; pixels with `DARK` or more are requested too, as in the renderer
    hits: Float32,  # (3, H, W) out: world x and y and the footprint, meters
) -> None:
    """Intersects the rays of a view with the floor, as `FloorSurface.distance_along_rays` does.

    The footprint of a pixel on the floor is the geometric mean of its width and its length. If the ray does not meet
    the floor, or the pixel is not requested, the footprint is -1 and x and y are arbitrary.
    """
    _, height, width = hits.shape
    eye_x, eye_y, eye_z, focal = camera[9], camera[10], camera[11], camera[12]
    drop = height_at(heights, grid, eye_x, eye_y) - eye_z
    for row in prange(height):
        v = (_F(row) + _HALF - camera[15]) / camera[13]
        planes = np.empty(_PLANES, np.float32)
        for x0 in range(0, width, _SEGMENT):
            count = min(_SEGMENT, width - x0)
            past = x0 + count
            mask, through = floor[row, x0:past], transmittance[row, x0:past]
            xs, ys, footprints = hits[0, row, x0:past], hits[1, row, x0:past], hits[2, row, x0:past]
            asked = np.int32(0)
            for i in range(count):
                asked += np.int32(mask[i] | (through[i] >= DARK))
            if asked == 0:
                footprints[:] = -_ONE
                continue
            _directions(camera, v, x0, drop, planes)
            if heights.size > 1:
                _approach(heights, grid, eye_x, eye_y, eye_z, planes)
            for i in range(count):
                xs[i] = eye_x + planes[_DISTANCE + i] * planes[_DX + i]
            for i in range(count):
                ys[i] = eye_y + planes[_DISTANCE + i] * planes[_DY + i]
            for i in range(count):
                distance = planes[_DISTANCE + i]
                met = (distance > _ZERO) & (mask[i] | (through[i] >= DARK))
                # `footprint_of`
                covered = distance * planes[_FORWARD + i] / (focal * np.sqrt(-planes[_DZ + i]))
                footprints[i] = covered if met else -_ONE
