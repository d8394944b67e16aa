"""Draws Gaussians close to the camera ray by ray. The local affine approximation of splatting enlarges Gaussians that
are wide relative to their depth over half a view. A wall beside a robot would then cover the floor at its feet,
although no ray there meets the wall.

In the frame in which a Gaussian is the unit sphere with center o, its alpha along a ray t d from the camera is greatest
at t = (o . d) / (d . d). The squared distance there is |o|^2 - (o . d)^2 / (d . d), a fraction of two polynomials of
the pixel. Splatting replaces it by one polynomial around the center.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.kernels import njit
from nvsim.render.arithmetic import FLAGS, LOG2E, exp2_below
from nvsim.render.ewa import rotation
from nvsim.render.kernel_types import ALPHA_MAX, EPS2D, LOG_CUT, NEAR, TILE, Float32, Int64, Mask, Vector3
from nvsim.splats.types import Gaussians

Float64 = NDArray[np.float64]
WIDE = 0.15
"""Share of the depth above which a standard deviation is too wide for splatting."""
_F = np.float32


def is_wide(gaussians: Gaussians, rows: Int64, camera: Camera) -> Mask:
    """(n,) bool: which of the `rows` (n,) of Gaussians are too wide, relative to their depth, to be splatted."""
    wide = np.zeros(len(rows), np.bool_)
    _find_wide(gaussians.means, gaussians.log_scales, rows, camera.world_to_camera, WIDE, wide)
    return wide


@njit(cache=True, nogil=True, error_model="numpy")
def _find_wide(
    means: Float32,  # (N, 3) meters, world
    log_scales: Float32,  # (N, 3)
    rows: Int64,  # (n,)
    pose: Float64,  # (4, 4) world to camera
    share: float,
    wide: Mask,  # (n,) out
) -> None:
    for i, row in enumerate(rows):
        z = pose[2, 3]
        for k in range(3):
            z += pose[2, k] * means[row, k]
        most = max(log_scales[row, 0], log_scales[row, 1], log_scales[row, 2])
        wide[i] = z > NEAR and math.exp(min(most, 30.0)) > share * z


def draw_by_rays(gaussians: Gaussians, camera: Camera, wanted: Mask) -> tuple[Float32, Float32, Float32]:
    """Draws Gaussians in the `wanted` tiles (lines, columns), the nearest to the camera first in all pixels.

    Returns the transmittance (H, W), the sums of weight * depth (H, W), and the sums of weight * normal (3, H, W),
    world. The depth is in meters along the optical axis, at the point of greatest alpha. The other tiles stay empty."""
    k = camera.intrinsics
    transmittance = np.ones((k.height, k.width), np.float32)
    depth, normal = np.zeros((k.height, k.width), np.float32), np.zeros((3, k.height, k.width), np.float32)
    order = np.argsort(np.linalg.norm(gaussians.means - camera.position.astype(np.float32), axis=1), kind="stable")
    lens = np.array([k.fx, k.fy, k.cx - 0.5, k.cy - 0.5])
    g = gaussians
    arrays = g.means, g.log_scales, g.quats, g.opacity_logits
    _draw(*arrays, order, camera.world_to_camera, lens, wanted, transmittance, depth, normal)
    return transmittance, depth, normal


@njit(fastmath=FLAGS, cache=True, nogil=True, error_model="numpy")
def _draw(
    means: Float32,  # (N, 3) meters, world
    log_scales: Float32,  # (N, 3) natural logarithm of the standard deviations in meters
    quats: Float32,  # (N, 4) w x y z, of any length, from the Gaussian's axes to the world
    opacity_logits: Float32,  # (N,)
    order: Int64,  # (N,) the rows, nearest first
    pose: Float64,  # (4, 4) world to camera
    lens: Float64,  # fx, fy, cx, cy, pixels, with the center of the first pixel at (0, 0)
    wanted: Mask,  # (lines, columns) tiles
    transmittance: Float32,  # (H, W) in and out
    depth: Float32,  # (H, W) out
    normal: Float32,  # (3, H, W) out
) -> None:
    height, width = transmittance.shape
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    turn, scale, center, fraction = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(10)
    for row in order:
        opacity = 1 / (1 + math.exp(-min(max(float(opacity_logits[row]), -40.0), 40.0)))
        reach = 2 * math.log(max(255 * opacity, 1e-9))
        length = math.sqrt(float(quats[row, 0] ** 2 + quats[row, 1] ** 2 + quats[row, 2] ** 2 + quats[row, 3] ** 2))
        if not reach > 0 or not length > 1e-10:
            continue
        w, x, y, z = quats[row, 0] / length, quats[row, 1] / length, quats[row, 2] / length, quats[row, 3] / length
        r = rotation(_F(w), _F(x), _F(y), _F(z))
        for i in range(3):
            center[i] = pose[i, 3]
            for j in range(3):
                center[i] += pose[i, j] * means[row, j]
                turn[i, j] = pose[i, 0] * r[j] + pose[i, 1] * r[3 + j] + pose[i, 2] * r[6 + j]
        thinnest = math.sqrt(EPS2D) * center[2] / max(fx, fy)  # least width after the low-pass filter of a pixel
        shortest = 0
        for k in range(3):
            scale[k] = max(math.exp(min(max(float(log_scales[row, k]), -20.0), 20.0)), thinnest)
            if log_scales[row, k] < log_scales[row, shortest]:
                shortest = k
        deep = _entry(turn, scale, center, reach, 2, 2)
        low, high = _slopes(turn, scale, center, reach, 0, deep)
        left, right = _pixels(fx * low + cx, fx * high + cx, width)
        low, high = _slopes(turn, scale, center, reach, 1, deep)
        top, bottom = _pixels(fy * low + cy, fy * high + cy, height)
        if left > right or top > bottom:
            continue
        _along_rays(turn, scale, center, lens, fraction)
        facing = turn[0, shortest] * center[0] + turn[1, shortest] * center[1] + turn[2, shortest] * center[2]
        sign = _F(-1) if facing > 0 else _F(1)
        towards_eye = sign * r[shortest], sign * r[3 + shortest], sign * r[6 + shortest]
        log_opacity = _F(math.log(opacity)) * LOG2E
        for line in range(top // TILE, bottom // TILE + 1):
            for column in range(left // TILE, right // TILE + 1):
                if wanted[line, column]:
                    begin, end = max(column * TILE, left), min(column * TILE + TILE, right + 1)
                    for v in range(max(line * TILE, top), min(line * TILE + TILE, bottom + 1)):
                        _draw_row(
                            fraction, log_opacity, towards_eye, v, begin, end,
                            transmittance[v], depth[v], normal[0, v], normal[1, v], normal[2, v],
                        )  # fmt: skip


@njit(error_model="numpy")
def _along_rays(
    turn: Float64,  # (3, 3) from the Gaussian's axes to those of the camera
    scale: Float64,  # (3,) meters
    center: Float64,  # (3,) meters, the camera's frame
    lens: Float64,  # fx, fy, cx, cy
    fraction: Float64,  # (10,) out
) -> None:
    """Writes o . o and, for the direction d = ((u - cx) / fx, (v - cy) / fy, 1) of a pixel (u, v), the coefficients of
    two polynomials: o . d (of u, v and 1) and d . d (of u u, u v, u, v v, v and 1)."""
    fraction[:] = 0
    for k in range(3):
        o = (turn[0, k] * center[0] + turn[1, k] * center[1] + turn[2, k] * center[2]) / scale[k]
        a, b = turn[0, k] / scale[k] / lens[0], turn[1, k] / scale[k] / lens[1]
        c = turn[2, k] / scale[k] - a * lens[2] - b * lens[3]
        fraction[0] += o * o
        fraction[1], fraction[2], fraction[3] = fraction[1] + o * a, fraction[2] + o * b, fraction[3] + o * c
        fraction[4], fraction[5], fraction[6] = fraction[4] + a * a, fraction[5] + a * b, fraction[6] + a * c
        fraction[7], fraction[8], fraction[9] = fraction[7] + b * b, fraction[8] + b * c, fraction[9] + c * c


@njit(fastmath=FLAGS, error_model="numpy")
def _draw_row(
    fraction: Float64,  # (10,) of `_along_rays`
    log_opacity: np.float32,  # to the base 2
    towards_eye: Vector3,  # its normal, world
    v: int,  # the row of pixels
    begin: int,  # its first pixel
    end: int,  # past its last pixel
    transmittance: Float32,  # (W,) in and out, like all following
    depth: Float32,
    normal_x: Float32,
    normal_y: Float32,
    normal_z: Float32,
) -> None:
    whole, p1, p0 = _F(fraction[0]), _F(fraction[1]), _F(fraction[2] * v + fraction[3])
    q2, q1 = _F(fraction[4]), _F(2 * (fraction[5] * v + fraction[6]))
    q0 = _F((fraction[7] * v + 2 * fraction[8]) * v + fraction[9])
    half, (nx, ny, nz) = _F(-0.5) * LOG2E, towards_eye
    for u in range(begin, end):
        towards = p1 * _F(u) + p0
        nearest = towards / ((q2 * _F(u) + q1) * _F(u) + q0)  # in depths, as d has depth 1
        power = max(log_opacity + half * (whole - towards * nearest), _F(-100))
        seen = (power >= LOG_CUT) & (towards > _F(0))
        weight = (min(exp2_below(power), ALPHA_MAX) if seen else _F(0)) * transmittance[u]
        transmittance[u] -= weight
        depth[u] += weight * nearest
        normal_x[u] += weight * nx
        normal_y[u] += weight * ny
        normal_z[u] += weight * nz


@njit(forceinline=True, error_model="numpy")
def _entry(turn: Float64, scale: Float64, center: Float64, reach: float, i: int, j: int) -> float:
    """An entry of the dual conic center center^T - reach * covariance in the camera's frame. A plane n through the
    camera touches the ellipsoid if n^T conic n = 0, and cuts it if this is less."""
    found = center[i] * center[j]
    for k in range(3):
        found -= reach * turn[i, k] * scale[k] * scale[k] * turn[j, k]
    return found


@njit(forceinline=True, error_model="numpy")
def _slopes(
    turn: Float64, scale: Float64, center: Float64, reach: float, axis: int, deep: float
) -> tuple[float, float]:
    """The least and the greatest x / z (axis 0) or y / z (1) of the rays in front of the camera that meet the
    ellipsoid. `deep` is its entry (2, 2), which is positive if the ellipsoid is entirely on one side of the camera."""
    across, along = _entry(turn, scale, center, reach, axis, 2), _entry(turn, scale, center, reach, axis, axis)
    root = math.sqrt(max(across * across - along * deep, 0.0))
    if deep > 0:
        return (across - root) / deep, (across + root) / deep
    if along <= 0 or deep == 0:
        return -math.inf, math.inf
    # It begins beside the camera, on one side of it: of the two roots, one of each sign, that of this side bounds it.
    if center[axis] < 0:
        return -math.inf, (across + root) / deep
    return (across - root) / deep, math.inf


@njit(forceinline=True, error_model="numpy")
def _pixels(low: float, high: float, count: int) -> tuple[int, int]:
    """The first and the last of `count` pixels between two positions."""
    return int(math.ceil(min(max(low, 0.0), float(count)))), int(math.floor(max(min(high, count - 1.0), -1.0)))
