"""The SH background at every pixel of a view (paper section III-C), and the gradient of its 25 coefficients, with the
polynomials of `sh_polynomials`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.kernels import njit, prange
from nvsim.render.sh_polynomials import EXPONENTS, change_of_basis, row_numbers

_F = np.float32
_ONE = _F(1)
Float32 = NDArray[np.float32]


def pack_camera(camera: Camera) -> Float32:
    """(16,) float32 for the kernels: camera-to-world rotation by rows, position, focal lengths, principal point."""
    k = camera.intrinsics
    packed = np.empty(16, np.float32)
    packed[0:9], packed[9:12] = camera.rotation.reshape(-1), camera.position
    packed[12:16] = k.fx, k.fy, k.cx, k.cy
    return packed


@njit(fastmath=True)
def sky_segment(
    camera: Float32,  # (16,) `pack_camera`
    terms: Float32,  # (25, 3) the coefficients after `change_of_basis`
    row: int,
    x0: int,  # first column of the segment
    count: int,  # of pixels
    channel: int,
    colors: Float32,  # (count,) out
) -> None:
    """One color channel of the background at `count` pixels of a row from x0 on."""
    v = (_F(row) + _F(0.5) - camera[15]) / camera[13]
    step, first = _ONE / camera[12], (_F(x0) + _F(0.5) - camera[14]) / camera[12]
    above = v * v + _ONE
    e0, e1, e2, e3, e4, o0, o1, o2, o3 = row_numbers(terms, v, channel)
    for x in range(count):
        u = _F(x) * step + first
        square = _ONE / (u * u + above)
        even = e0 + u * (e1 + u * (e2 + u * (e3 + u * e4)))
        odd = o0 + u * (o1 + u * (o2 + u * o3))
        colors[x] = square * (square * even + np.sqrt(square) * odd)


@njit(parallel=True, cache=True, fastmath=True)
def _evaluate(
    camera: Float32,  # (16,) `pack_camera`
    terms: Float32,  # (25, 3) the coefficients after `change_of_basis`
    out: Float32,  # (3, H, W) colors
) -> None:
    _, height, width = out.shape
    for y in prange(height):
        for c in range(3):
            sky_segment(camera, terms, y, 0, width, c, out[c, y])


@njit(parallel=True, cache=True, fastmath=True)
def _moments(
    camera: Float32,  # (16,) `pack_camera`
    d_background: Float32,  # (3, H, W)
    rows: Float32,  # (H, 9, 3) out: the gradient of the nine numbers of each row
) -> None:
    _, height, width = d_background.shape
    for y in prange(height):
        v = (_F(y) + _F(0.5) - camera[15]) / camera[13]
        step, first = _ONE / camera[12], (_F(0.5) - camera[14]) / camera[12]
        above = v * v + _ONE
        for c in range(3):
            line = d_background[c, y]
            e0 = e1 = e2 = e3 = e4 = o0 = o1 = o2 = o3 = _F(0)
            for x in range(width):
                u = _F(x) * step + first
                square = _ONE / (u * u + above)
                even = line[x] * square
                odd = even * np.sqrt(square)
                even *= square
                e0 += even
                o0 += odd
                even *= u
                odd *= u
                e1 += even
                o1 += odd
                even *= u
                odd *= u
                e2 += even
                o2 += odd
                even *= u
                odd *= u
                e3 += even
                o3 += odd
                e4 += even * u
            rows[y, 0, c], rows[y, 1, c], rows[y, 2, c], rows[y, 3, c], rows[y, 4, c] = e0, e1, e2, e3, e4
            rows[y, 5, c], rows[y, 6, c], rows[y, 7, c], rows[y, 8, c] = o0, o1, o2, o3


def evaluate(camera: Camera, coefficients: Float32, out: Float32) -> None:
    """Writes the background along every pixel's ray to `out` (3, H, W); `coefficients` is (25, 3)."""
    terms = (change_of_basis(camera.rotation) @ coefficients).astype(np.float32)
    _evaluate(pack_camera(camera), terms, out)


def evaluate_gradient(camera: Camera, d_background: Float32, rows: Float32) -> Float32:
    """(25, 3) the gradient of the coefficients from that of the background (3, H, W). `rows` (H, 9, 3) is scratch."""
    _moments(pack_camera(camera), d_background, rows)
    k, height = camera.intrinsics, len(rows)
    v = (np.arange(height) + 0.5 - k.cy) / k.fy
    sums = np.tensordot(v[:, None] ** np.arange(5), rows.astype(np.float64), axes=(0, 0))  # (5 powers of v, 9, 3)
    d_terms = np.stack([sums[j, i if at < 15 else 5 + i] for at, (i, j) in enumerate(EXPONENTS)])
    return np.asarray(change_of_basis(camera.rotation).T @ d_terms, np.float32)
