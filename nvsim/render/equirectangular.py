"""The resampling of cube faces into an equirectangular image, without seams.

The faces see a little more than their 90 degrees. Where two of them see the same ray, near an edge of the cube, both
are mixed, so that what differs between them there (the local affine approximation of splatting, the order by depth
along another axis) fades from one to the other. Every pixel is the mean of four bilinear samples, because near the
corners of the cube the faces are up to three times as fine as at their centres.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange

from nvsim.geometry.camera import Intrinsics
from nvsim.render.arithmetic import FLAGS
from nvsim.render.layout import TILE
from nvsim.render.types import Float32

_F = np.float32
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)
BLEND = 0.05
"""A face counts where the ray's component along its axis is at least 1 - BLEND of the largest one: up to 1.5 degrees
beyond the edge of the cube."""
_FINER = 1.2  # face pixels for each pixel of the panorama on the horizon, at a face's centre


def face_intrinsics(width: int) -> Intrinsics:
    """Of the six faces for a panorama `width` pixels wide: square, whole tiles, with the blended border."""
    focal = _FINER * width / (2 * math.pi)
    side = TILE * math.ceil((2 * focal / (1 - BLEND) + 2) / TILE)
    # The outermost pixel is the neighbour of the last bilinear sample.
    focal = (side / 2 - 1) * (1 - BLEND)
    return Intrinsics(side, side, focal, focal, side / 2, side / 2)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _on_face(face: Any, x: Any, y: Any, z: Any) -> Any:
    """x right, y down and z forward on a face of `panorama.cube` of a ray whose axes are right, ahead and up."""
    if face == 0:
        return x, y, z
    if face == 1:
        return x, -z, y
    if face == 2:
        return -y, -z, x
    if face == 3:
        return -x, -z, -y
    if face == 4:
        return y, -z, -x
    return x, -y, -z


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _weights(x: Any, y: Any, z: Any) -> Any:
    """Of the three faces that the ray may be seen by, ahead or behind, right or left, up or down; their sum is one."""
    ax, ay, az = abs(x), abs(y), abs(z)
    least = _F(1 - BLEND) * max(ax, max(ay, az))
    wx, wy, wz = max(ax - least, _ZERO), max(ay - least, _ZERO), max(az - least, _ZERO)
    scale = _ONE / (wx + wy + wz)
    return wx * scale, wy * scale, wz * scale


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _pixel(side: Any, face: Any, focal: Any, x: Any, y: Any, z: Any) -> Any:
    """Column and line on the face, counted from the centre of its first pixel, of which the next ones exist too."""
    a, b, c = _on_face(face, x, y, z)
    middle, most = _F(side) * _HALF - _HALF, _F(side - 2)
    return min(max(focal * a / c + middle, _ZERO), most), min(max(focal * b / c + middle, _ZERO), most)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _add(faces: Any, face: Any, focal: Any, weight: Any, x: Any, y: Any, z: Any, pixel: Any) -> None:
    u, v = _pixel(faces.shape[1], face, focal, x, y, z)
    column, line = np.int64(u), np.int64(v)
    fu, fv = u - _F(column), v - _F(line)
    w00, w01 = weight * (_ONE - fv) * (_ONE - fu), weight * (_ONE - fv) * fu
    w10, w11 = weight * fv * (_ONE - fu), weight * fv * fu
    top, bottom = faces[face, line], faces[face, line + 1]
    for channel in range(4):
        pixel[channel] += (
            w00 * top[column, channel]
            + w01 * top[column + 1, channel]
            + w10 * bottom[column, channel]
            + w11 * bottom[column + 1, channel]
        )


@njit(parallel=True, cache=True, nogil=True, fastmath=FLAGS, error_model="numpy")
def resample(faces: Any, focal: Any, azimuths: Any, elevations: Any, mask: Any, image: Any) -> None:
    """faces       (6, S, S, 4) float32, in the order of `panorama.cube`
    focal       float32, pixels
    azimuths    (2 W, 2) float32 sine and cosine of the half columns' headings, from that of the second face on
    elevations  (2 H, 2) float32 the same of the half rows' elevations
    mask        (H, W) bool, which pixels are wanted
    image       out (H, W, 4), zero where none is
    """
    height, width = image.shape[:2]
    for row in prange(height):
        pixel = np.empty(4, np.float32)
        for column in range(width):
            pixel[:] = _ZERO
            if not mask[row, column]:
                image[row, column] = pixel
                continue
            for part in range(4):
                vertical, horizontal = elevations[2 * row + (part >> 1)], azimuths[2 * column + (part & 1)]
                x, y, z = horizontal[0] * vertical[1], horizontal[1] * vertical[1], vertical[0]
                wx, wy, wz = _weights(x, y, z)
                if wx > _ZERO:
                    _add(faces, 2 if x > _ZERO else 4, focal, wx, x, y, z, pixel)
                if wy > _ZERO:
                    _add(faces, 1 if y > _ZERO else 3, focal, wy, x, y, z, pixel)
                if wz > _ZERO:
                    _add(faces, 0 if z > _ZERO else 5, focal, wz, x, y, z, pixel)
            for channel in range(4):
                image[row, column, channel] = _F(0.25) * pixel[channel]


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _mark(seen: Any, face: Any, focal: Any, x: Any, y: Any, z: Any) -> None:
    u, v = _pixel(seen.shape[1], face, focal, x, y, z)
    column, line = np.int64(u), np.int64(v)
    seen[face, line, column] = True
    seen[face, line, column + 1] = True
    seen[face, line + 1, column] = True
    seen[face, line + 1, column + 1] = True


@njit(cache=True, nogil=True, fastmath=FLAGS, error_model="numpy")
def mark_seen(focal: Any, azimuths: Any, elevations: Any, mask: Any, seen: Any) -> None:
    """Sets `seen` (6, S, S) bool where `resample` reads the faces for the pixels of `mask`."""
    for row in range(mask.shape[0]):
        for column in range(mask.shape[1]):
            if not mask[row, column]:
                continue
            for part in range(4):
                vertical, horizontal = elevations[2 * row + (part >> 1)], azimuths[2 * column + (part & 1)]
                x, y, z = horizontal[0] * vertical[1], horizontal[1] * vertical[1], vertical[0]
                wx, wy, wz = _weights(x, y, z)
                if wx > _ZERO:
                    _mark(seen, 2 if x > _ZERO else 4, focal, x, y, z)
                if wy > _ZERO:
                    _mark(seen, 1 if y > _ZERO else 3, focal, x, y, z)
                if wz > _ZERO:
                    _mark(seen, 0 if z > _ZERO else 5, focal, x, y, z)


def half_angles(width: int, height: int) -> tuple[Float32, Float32]:
    """The `azimuths` and `elevations` of `resample`: the middle column looks straight ahead, the first row up."""
    heading = ((np.arange(2 * width) + 0.5) / (2 * width) - 0.5) * 2 * math.pi
    elevation = (0.5 - (np.arange(2 * height) + 0.5) / (2 * height)) * math.pi
    return _sine_cosine(heading), _sine_cosine(elevation)


def _sine_cosine(angle: np.ndarray) -> Float32:
    return np.stack([np.sin(angle), np.cos(angle)], axis=1).astype(np.float32)
