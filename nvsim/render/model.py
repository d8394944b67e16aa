"""Renders one submap model: Gaussians, and the background where they are transparent (paper section III-C)."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import FLAGS
from nvsim.render.backends import Backend, RenderOutput, expected_depth, resolve_backend
from nvsim.render.floor_rays import DARK, HITS, RAYS, SEGMENT, height_at, meet_segment, pack_floor
from nvsim.render.floor_texture import PLANES, add_segment, pack_texture
from nvsim.render.kernel_types import Float32, Int64
from nvsim.render.sh_polynomials import COEFFICIENTS, change_of_basis
from nvsim.render.sky import pack_camera, sky_segment
from nvsim.render.workspace import LOCK, RenderBuffers, as_kernel_array, pixels_of
from nvsim.splats.types import Gaussians, SubmapModel


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


_workspace = RenderBuffers()


def render_gaussians(
    gaussians: Gaussians,
    camera: Camera,
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
    antialiased: bool = True,
    tiles: NDArray[np.bool_] | None = None,
    backend: Backend = "auto",
) -> RenderOutput:
    """Renders the requested channels "rgb", "alpha", "depth", "normal", as in RenderOutput, over black.

    `tiles` (lines, columns) bool, one per 16x16 pixels (see workspace.tiles_of), selects the tiles to draw; the others
    are zero.

    Safe to call from several threads; calls run one after the other, each with all cores. Raises ValueError for an
    unknown channel, InputError for a backend that cannot run here.
    """
    output, _ = render_over(gaussians, camera, channels, antialiased, tiles, backend)
    return output


def render_over(
    gaussians: Gaussians,
    camera: Camera,
    channels: frozenset[str],
    antialiased: bool,
    tiles: NDArray[np.bool_] | None = None,
    backend: Backend = "auto",
    lasting: bool = False,
    workspace: RenderBuffers | None = None,
) -> tuple[RenderOutput, Float32]:
    """As `render_gaussians`, and also the transmittance (H, W) = 1 - alpha for a background.

    lasting    the arrays of `gaussians` never change, so that a GPU can keep them
    workspace  buffers that no other thread uses meanwhile; without it the shared ones are used, under their lock
    """
    unknown = channels - {"rgb", "alpha", "depth", "normal"}
    if unknown:
        raise ValueError(f"unknown render channels: {', '.join(sorted(unknown))}")
    if resolve_backend(backend) == "gsplat":
        from nvsim.render import gsplat_backend

        whole, left = gsplat_backend.render_over(gaussians, camera, channels, antialiased, lasting)
        return (whole, left) if tiles is None else _clear_other_tiles(whole, left, tiles)
    if workspace is not None:
        return _render_gaussians(gaussians, camera, channels, antialiased, tiles, workspace)
    with LOCK:
        return _render_gaussians(gaussians, camera, channels, antialiased, tiles, _workspace)


def _render_gaussians(
    gaussians: Gaussians,
    camera: Camera,
    channels: frozenset[str],
    antialiased: bool,
    tiles: NDArray[np.bool_] | None,
    workspace: RenderBuffers,
) -> tuple[RenderOutput, Float32]:
    g, k = gaussians, camera.intrinsics
    arrays = Gaussians(*map(as_kernel_array, g.arrays))
    workspace.project(arrays, camera, antialiased, tiles=tiles)
    workspace.bin()
    rgb, transmittance, depth, normal = workspace.draw(k.height, k.width, bool(channels & {"depth", "normal"}))
    output = RenderOutput()
    if "rgb" in channels:
        output.rgb = rgb
    if channels & {"alpha", "depth"}:
        alpha = 1 - transmittance
        if "alpha" in channels:
            output.alpha = alpha
        if "depth" in channels:
            output.depth = expected_depth(depth, alpha)
    if "normal" in channels:
        output.normal = normal
    return output, transmittance


def _clear_other_tiles(
    output: RenderOutput, transmittance: Float32, tiles: NDArray[np.bool_]
) -> tuple[RenderOutput, Float32]:
    # For a backend that can only render whole views.
    inside = pixels_of(tiles, *transmittance.shape)
    for channel in (output.rgb, output.alpha, output.depth, output.normal):
        if channel is not None:
            channel[~inside] = 0
    return output, np.where(inside, transmittance, np.float32(1))


def render_model(
    model: SubmapModel,
    camera: Camera,
    channels: frozenset[str] = frozenset({"rgb", "alpha"}),
    tiles: NDArray[np.bool_] | None = None,
    backend: Backend = "auto",
) -> RenderOutput:
    """Renders a view. rgb = Gaussians + (1 - alpha) * background, (H, W, 3), not clamped. Alpha (H, W), depth (H, W),
    and normal (H, W, 3) are of the Gaussians alone. Only the given `tiles` are drawn, see `render_gaussians`.

    Safe to call from several threads. Raises ValueError for an unknown channel, InputError for a backend that
    cannot run here.
    """
    # Colors that depend on the position are overwritten by the next view.
    lasting = model.appearance is None
    gaussians = model.gaussians_at(camera.position)
    output, transmittance = render_over(gaussians, camera, channels, model.antialiased, tiles, backend, lasting)
    if output.rgb is not None:
        if tiles is not None:
            k = camera.intrinsics
            transmittance = transmittance * pixels_of(tiles, k.height, k.width)
        paint_background(model, camera, transmittance, output.rgb)
    return output
