"""The background of a submap model at every pixel: SH of the direction, plus the floor texture if the ray meets the
floor. The SH are from paper section III-C; the texture is not in the paper."""

from __future__ import annotations

import numba
import numpy as np

from nvsim.geometry.camera import Camera
from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import FLAGS
from nvsim.render.floor_rays import DARK, HITS, RAYS, SEGMENT, height_at, meet_segment, pack_floor
from nvsim.render.floor_texture import PLANES, add_segment, pack_texture
from nvsim.render.kernel_types import Float32, Int64
from nvsim.render.sh_polynomials import COEFFICIENTS, change_of_basis
from nvsim.render.sky import pack_camera, sky_segment
from nvsim.render.workspace import LOCK
from nvsim.splats.types import SubmapModel


@njit(parallel=True, cache=True, nogil=True, fastmath=FLAGS, error_model="numpy")
def paint(
    camera: Float32,  # (16,) `pack_camera`
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
    height, width = transmittance.shape
    flat = texels.reshape(-1)
    drop = height_at(heights, grid, camera[9], camera[10]) - camera[11]
    for thread in prange(threads):
        rays, plane = np.empty(RAYS, np.float32), np.zeros(PLANES, np.float32)
        places, colors = np.empty(SEGMENT, np.int32), np.empty((3, SEGMENT), np.float32)
        for row in range(thread, height, threads):
            for x0 in range(0, width, SEGMENT):
                count = min(SEGMENT, width - x0)
                through = transmittance[row, x0 : x0 + count]
                lightest = through[0]
                for i in range(1, count):
                    lightest = max(lightest, through[i])
                if lightest < DARK:
                    continue
                for channel in range(3):
                    sky_segment(camera, terms, row, x0, count, channel, colors[channel])
                if table.shape[0] > 0:
                    meet_segment(camera, heights, grid, drop, row, x0, rays, plane[:HITS])
                    add_segment(table, sizes, bounds, flat, count, plane, places, colors[0], colors[1], colors[2])
                for i in range(count):
                    if through[i] >= DARK:
                        for channel in range(3):
                            rgb[row, x0 + i, channel] += through[i] * colors[channel, i]


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
    threads = numba.get_num_threads()
    with LOCK:
        paint(
            pack_camera(camera), terms, heights, grid, t.texels, t.table, t.sizes, t.bounds, threads, transmittance, rgb
        )
