"""Where rays meet the floor. Views are processed one segment of a row at a time, in loops without branches that LLVM
vectorizes. This takes a third of the time of one ray after the other."""

from __future__ import annotations

import numpy as np

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import FLAGS
from nvsim.render.kernel_types import Float32, Mask

DARK = np.float32(1 / 1024)
"""Light that is invisible in 8 bits."""
SEGMENT = 64
"""Pixels of a row that are processed at the same time."""
RAYS, HITS = 5 * SEGMENT, 3 * SEGMENT
"""Sizes of the planes of a segment: rays (see `_directions`), and hits: world x and y and the footprint, meters."""
_F = np.float32
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)
_FLATTEST = _F(-0.02)  # as FloorSurface.distance_along_rays
_ITERATIONS = 4
_CLOSE = _F(1e-5)  # meters; further iterations change nothing
_DX, _DY, _DZ, _FORWARD, _DISTANCE = 0, SEGMENT, 2 * SEGMENT, 3 * SEGMENT, 4 * SEGMENT


def pack_floor(floor: FloorSurface) -> tuple[Float32, Float32]:
    """Heights (rows, columns), and origin x, y and spacing (3,); meters."""
    heights = np.require(floor.heights, np.float32, ["C", "A", "W"])
    return heights, np.array([*floor.origin, floor.spacing], np.float32)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def height_at(
    heights: Float32,  # (rows, columns) meters, world z
    grid: Float32,  # (3,) origin x and y and the spacing, meters, world
    x: np.float32,  # meters, world, as y
    y: np.float32,
) -> np.float32:
    """FloorSurface.height_at: meters; `heights` (rows, columns) and `grid` (3,) from `pack_floor`."""
    rows, columns = heights.shape
    c = min(max((x - grid[0]) / grid[2], _ZERO), _F(columns - 1))
    r = min(max((y - grid[1]) / grid[2], _ZERO), _F(rows - 1))
    c0, r0 = np.int64(c), np.int64(r)
    c1, r1 = min(c0 + 1, columns - 1), min(r0 + 1, rows - 1)
    fc, fr = c - _F(c0), r - _F(r0)
    low = heights[r0, c0] * (_ONE - fc) + heights[r0, c1] * fc
    high = heights[r1, c0] * (_ONE - fc) + heights[r1, c1] * fc
    return low * (_ONE - fr) + high * fr


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def distance_to_floor(
    heights: Float32,  # (rows, columns) meters, world z
    grid: Float32,  # (3,) origin x and y and the spacing, meters, world
    ex: np.float32,  # camera position, meters, world, as ey and ez
    ey: np.float32,
    ez: np.float32,
    dx: np.float32,  # unit direction, world, as dy and dz
    dy: np.float32,
    dz: np.float32,
) -> np.float32:
    """FloorSurface.distance_along_rays: meters along the unit direction from the camera, -1 if there is none.
    `heights` is (rows, columns), `grid` (3,)."""
    if not dz < _FLATTEST:
        return -_ONE
    distance = (height_at(heights, grid, ex, ey) - ez) / dz
    if heights.size > 1:
        for _ in range(_ITERATIONS):
            before = distance
            distance = (height_at(heights, grid, ex + distance * dx, ey + distance * dy) - ez) / dz
            if abs(distance - before) < _CLOSE:
                break
    return distance if distance > _ZERO else -_ONE


@njit(fastmath=FLAGS, error_model="numpy")
def _directions(
    camera: Float32,  # (16,) `pack_camera`
    v: np.float32,  # y of the row over z, in the camera frame
    x0: int,  # first column of the segment
    drop: np.float32,  # meters from the camera up to the floor, so below zero
    planes: Float32,  # (RAYS,) out
) -> None:
    # Unit directions, their forward component, and the distance to a level floor at height `drop` relative to the
    # camera. A ray that does not point down gets a substitute direction and the distance -1.
    step, first = _ONE / camera[12], (_F(x0) + _HALF - camera[14]) / camera[12]
    a, b, c = camera[0], camera[3], camera[6]
    ahead_x, ahead_y, ahead_z = camera[1] * v + camera[2], camera[4] * v + camera[5], camera[7] * v + camera[8]
    above = v * v + _ONE
    for i in range(SEGMENT):
        u = _F(i) * step + first
        forward = _ONE / np.sqrt(u * u + above)
        dz = (c * u + ahead_z) * forward
        met = dz < _FLATTEST
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
    planes: Float32,  # (RAYS,) of `_directions`; the distances change
) -> None:
    # The fixed-point iteration of `distance_to_floor`, until no ray of the segment moves.
    rows, columns = heights.shape
    flat = heights.reshape(-1)
    start_x, start_y, per_meter = grid[0], grid[1], _ONE / grid[2]
    last_column, last_row = _F(columns - 1), _F(rows - 1)
    wide, high = np.int32(columns), np.int32(rows)
    one = np.int32(1)
    for _ in range(_ITERATIONS):
        moved = np.int32(0)
        for i in range(SEGMENT):
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
            moved += np.int32(met & (abs(distance - before) >= _CLOSE))
            planes[_DISTANCE + i] = distance if met else -_ONE
        if moved == 0:
            break


@njit(fastmath=FLAGS, error_model="numpy")
def meet_segment(
    camera: Float32,  # (16,) `pack_camera`
    heights: Float32,  # (rows, columns) of the floor surface, meters, world z
    grid: Float32,  # (3,) of the floor surface: origin x and y and the spacing, meters, world
    drop: np.float32,  # meters from the camera up to the floor below it
    row: int,
    x0: int,  # first column of the segment
    rays: Float32,  # (RAYS,) scratch
    hits: Float32,  # (HITS,) out: world x and y and the footprint of each pixel, meters
) -> None:
    """Intersects the rays of a segment of a view with the floor, as `FloorSurface.distance_along_rays` does.

    The footprint of a pixel on the floor is the geometric mean of its width and its length. If a ray does not meet the
    floor, its footprint is -1, and x and y are arbitrary."""
    eye_x, eye_y, eye_z, focal = camera[9], camera[10], camera[11], camera[12]
    _directions(camera, (_F(row) + _HALF - camera[15]) / camera[13], x0, drop, rays)
    if heights.size > 1:
        _approach(heights, grid, eye_x, eye_y, eye_z, rays)
    for i in range(SEGMENT):
        hits[i] = eye_x + rays[_DISTANCE + i] * rays[_DX + i]
    for i in range(SEGMENT):
        hits[SEGMENT + i] = eye_y + rays[_DISTANCE + i] * rays[_DY + i]
    for i in range(SEGMENT):
        distance = rays[_DISTANCE + i]
        covered = distance * rays[_FORWARD + i] / (focal * np.sqrt(-rays[_DZ + i]))
        hits[2 * SEGMENT + i] = covered if distance > _ZERO else -_ONE


@njit(parallel=True, cache=True, fastmath=FLAGS, error_model="numpy")
def meet_floor(
    camera: Float32,  # (16,) `pack_camera`
    heights: Float32,  # (rows, columns) of the floor surface, meters, world z
    grid: Float32,  # (3,) of the floor surface: origin x and y and the spacing, meters, world
    floor: Mask,  # (H, W) pixels that are always requested
    transmittance: Float32,  # (H, W) 0 to 1; pixels with `DARK` or more are requested too, as in the renderer
    hits: Float32,  # (3, H, W) out: world x and y and the footprint, meters
) -> None:
    """Writes the hits of `meet_segment` for a whole view. Pixels that are not requested have the footprint -1."""
    _, height, width = hits.shape
    drop = height_at(heights, grid, camera[9], camera[10]) - camera[11]
    for row in prange(height):
        rays, found = np.empty(RAYS, np.float32), np.empty(HITS, np.float32)
        for x0 in range(0, width, SEGMENT):
            count = min(SEGMENT, width - x0)
            past = x0 + count
            mask, through = floor[row, x0:past], transmittance[row, x0:past]
            footprints = hits[2, row, x0:past]
            asked = np.int32(0)
            for i in range(count):
                asked += np.int32(mask[i] | (through[i] >= DARK))
            if asked == 0:
                footprints[:] = -_ONE
                continue
            meet_segment(camera, heights, grid, drop, row, x0, rays, found)
            hits[0, row, x0:past] = found[:count]
            hits[1, row, x0:past] = found[SEGMENT : SEGMENT + count]
            for i in range(count):
                footprints[i] = found[2 * SEGMENT + i] if mask[i] | (through[i] >= DARK) else -_ONE
