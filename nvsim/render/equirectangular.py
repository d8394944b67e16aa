"""Resamples perspective views into an equirectangular image without seams.

It uses eighteen narrow views instead of the six of a cube. The local affine approximation of splatting, and sorting by
depth along one axis, are less exact far from the axis. Here rays are 27 degrees off the axis on most edges and 35 at
most; on a cube they are 45 and 55. Where two views have similar angles, both are blended, so that differences fade.
Every pixel is the mean of four bilinear samples.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import FLAGS
from nvsim.render.kernel_types import TILE, Float32, Mask
from nvsim.render.workspace import tiles_of

_F = np.float32
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)
_BLEND = _F(0.03)
# A view counts if the cosine between its axis and the ray is less than this below the largest one: within 2.2 degrees
# of the edge between two views.
_SLOPE = 0.80  # tangent of the largest angle along an image axis at which a view counts, rounded up
_FINER = 1.2  # pixels of a view, at its center, per pixel of the panorama on the horizon

# Headings and elevations of the axes, degrees: those of the square faces of a rhombicuboctahedron.
_AXES = (
    *((45.0 * k, 0.0) for k in range(8)),
    *((90.0 * k, 45.0) for k in range(4)),
    *((90.0 * k, -45.0) for k in range(4)),
    (0.0, 90.0),
    (0.0, -90.0),
)


def views_around(position: NDArray[np.floating], width: int, heading: float) -> list[Camera]:
    """The cameras at `position` (3,), meters, of a panorama `width` pixels wide whose middle looks along `heading`
    (radians)."""
    focal = _FINER * width / (2 * math.pi)
    side = TILE * math.ceil((2 * focal * _SLOPE + 2) / TILE)
    intrinsics = Intrinsics(side, side, focal, focal, side / 2, side / 2)
    at = np.asarray(position, np.float64)
    return [Camera(intrinsics, camera_pose(at, heading + math.radians(h), math.radians(e))) for h, e in _AXES]


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _project_to_view(
    axes: Float32,  # (views, 3, 3) as in `resample`
    view: int,
    focal: np.float32,  # pixels
    side: int,  # width and height of a view, pixels
    x: np.float32,  # unit direction, as y and z, where forward is y and up is z
    y: np.float32,
    z: np.float32,
) -> tuple[np.float32, np.float32]:
    """Column and line of a ray in a view, counted from the center of the first pixel; the next ones exist too."""
    a = axes[view, 0, 0] * x + axes[view, 0, 1] * y + axes[view, 0, 2] * z
    b = axes[view, 1, 0] * x + axes[view, 1, 1] * y + axes[view, 1, 2] * z
    c = axes[view, 2, 0] * x + axes[view, 2, 1] * y + axes[view, 2, 2] * z
    middle, most = _F(side) * _HALF - _HALF, _F(side - 2)
    return min(max(focal * a / c + middle, _ZERO), most), min(max(focal * b / c + middle, _ZERO), most)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _weigh_pixel(
    axes: Float32,  # (views, 3, 3) as in `resample`, like the next two
    azimuths: Float32,  # (2 W, 2)
    elevations: Float32,  # (2 H, 2)
    row: int,
    column: int,
    weights: Float32,  # (views,) out
) -> np.float32:
    """Fills `weights` (views,), with zero for a view that does not count; returns their sum."""
    # Between the four samples, close enough to the center of the pixel: on its diagonal, not normalized.
    x = azimuths[2 * column, 0] * elevations[2 * row, 1] + azimuths[2 * column + 1, 0] * elevations[2 * row + 1, 1]
    y = azimuths[2 * column, 1] * elevations[2 * row, 1] + azimuths[2 * column + 1, 1] * elevations[2 * row + 1, 1]
    z = elevations[2 * row, 0] + elevations[2 * row + 1, 0]
    scale = _ONE / math.sqrt(x * x + y * y + z * z)
    best = _ZERO
    for view in range(weights.shape[0]):
        cosine = scale * (axes[view, 2, 0] * x + axes[view, 2, 1] * y + axes[view, 2, 2] * z)
        weights[view] = cosine
        best = max(best, cosine)
    total = _ZERO
    for view in range(weights.shape[0]):
        weights[view] = max(weights[view] - best + _BLEND, _ZERO)
        total += weights[view]
    return total


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _add(
    views: Float32,  # (views, S, S, 4)
    view: int,
    u: np.float32,  # column and line of `_project_to_view`
    v: np.float32,
    weight: np.float32,
    pixel: Float32,  # (4,) to which the sample is added
) -> None:
    column, line = np.int64(u), np.int64(v)
    fu, fv = u - _F(column), v - _F(line)
    w00, w01 = weight * (_ONE - fv) * (_ONE - fu), weight * (_ONE - fv) * fu
    w10, w11 = weight * fv * (_ONE - fu), weight * fv * fu
    top, bottom = views[view, line], views[view, line + 1]
    for channel in range(4):
        pixel[channel] += (
            w00 * top[column, channel]
            + w01 * top[column + 1, channel]
            + w10 * bottom[column, channel]
            + w11 * bottom[column + 1, channel]
        )


@njit(parallel=True, cache=True, nogil=True, fastmath=FLAGS, error_model="numpy")
def resample(
    first: Float32,  # (views, S, S, 4) four channels of the views; (0, ...) if not needed
    second: Float32,  # (views, S, S, 4) four more channels; (0, ...) if not needed
    axes: Float32,  # (views, 3, 3) rows right, down, and forward of each view, where forward is y and up is z
    focal: np.float32,  # of the views, pixels
    azimuths: Float32,  # (2 W, 2) sine and cosine of the headings of the half columns, counted from forward
    elevations: Float32,  # (2 H, 2) sine and cosine of the elevations of the half rows
    mask: Mask,  # (H, W) requested pixels
    first_image: Float32,  # (H, W, 4) out, zero for other pixels; (0, W, 4) without `first`
    second_image: Float32,  # (H, W, 4) out, zero for other pixels; (0, W, 4) without `second`
) -> None:
    """Writes the views as one equirectangular image: every pixel is a mean of the views whose axes are near its ray."""
    height, width = mask.shape
    side = max(first.shape[1], second.shape[1])
    for row in prange(height):
        pixels = np.empty((2, 4), np.float32)
        weights = np.empty(axes.shape[0], np.float32)
        for column in range(width):
            pixels[:] = _ZERO
            if mask[row, column]:
                # One selection of views for the whole pixel, because its four samples are less than a pixel apart.
                scale = _F(0.25) / _weigh_pixel(axes, azimuths, elevations, row, column, weights)
                for view in range(axes.shape[0]):
                    weight = scale * weights[view]
                    if weight > _ZERO:
                        for part in range(4):
                            vertical, horizontal = elevations[2 * row + (part >> 1)], azimuths[2 * column + (part & 1)]
                            x, y, z = horizontal[0] * vertical[1], horizontal[1] * vertical[1], vertical[0]
                            u, v = _project_to_view(axes, view, focal, side, x, y, z)
                            if first.shape[0] > 0:
                                _add(first, view, u, v, weight, pixels[0])
                            if second.shape[0] > 0:
                                _add(second, view, u, v, weight, pixels[1])
            if first.shape[0] > 0:
                first_image[row, column] = pixels[0]
            if second.shape[0] > 0:
                second_image[row, column] = pixels[1]


@njit(parallel=True, cache=True, nogil=True, fastmath=FLAGS, error_model="numpy")
def _mark_seen(
    axes: Float32,  # (views, 3, 3) as in `resample`, like the next four
    focal: np.float32,
    azimuths: Float32,
    elevations: Float32,
    mask: Mask,
    seen: Mask,  # (views, S, S) set where `resample` reads
) -> None:
    # Several threads can set one entry, to an equal value.
    side = seen.shape[1]
    for row in prange(mask.shape[0]):
        weights = np.empty(axes.shape[0], np.float32)
        for column in range(mask.shape[1]):
            if not mask[row, column]:
                continue
            _weigh_pixel(axes, azimuths, elevations, row, column, weights)
            for view in range(axes.shape[0]):
                if weights[view] > _ZERO:
                    for part in range(4):
                        vertical, horizontal = elevations[2 * row + (part >> 1)], azimuths[2 * column + (part & 1)]
                        x, y, z = horizontal[0] * vertical[1], horizontal[1] * vertical[1], vertical[0]
                        u, v = _project_to_view(axes, view, focal, side, x, y, z)
                        at, down = np.int64(u), np.int64(v)
                        seen[view, down, at] = True
                        seen[view, down, at + 1] = True
                        seen[view, down + 1, at] = True
                        seen[view, down + 1, at + 1] = True


def pixels_seen(width: int, height: int, mask: Mask) -> Mask:
    """(views, S, S) bool: the pixels of the views that `resample` reads for the pixels of `mask` (H, W)."""
    intrinsics = views_around(np.zeros(3), width, 0.0)[0].intrinsics
    seen = np.zeros((len(_AXES), intrinsics.height, intrinsics.width), bool)
    _mark_seen(axes_ahead(), np.float32(intrinsics.fx), *half_angles(width, height), mask, seen)
    return seen


@lru_cache(maxsize=8)
def tiles_seen(width: int, height: int) -> tuple[Mask, ...]:
    """For every view, the tiles (lines, columns) that a complete panorama needs."""
    return tuple(map(tiles_of, pixels_seen(width, height, np.ones((height, width), bool))))


def axes_ahead() -> Float32:
    """The `axes` (views, 3, 3) of `resample`."""
    cameras = views_around(np.zeros(3), 1, 0.0)
    return np.stack([np.ascontiguousarray(c.rotation.T) for c in cameras]).astype(np.float32)


def half_angles(width: int, height: int) -> tuple[Float32, Float32]:
    """The `azimuths` (2 W, 2) and `elevations` (2 H, 2) of `resample`: the middle column looks forward, the first row
    up."""
    heading = ((np.arange(2 * width) + 0.5) / (2 * width) - 0.5) * 2 * math.pi
    elevation = (0.5 - (np.arange(2 * height) + 0.5) / (2 * height)) * math.pi
    return _sine_cosine(heading), _sine_cosine(elevation)


def _sine_cosine(angle: NDArray[np.float64]) -> Float32:
    return np.stack([np.sin(angle), np.cos(angle)], axis=1).astype(np.float32)
