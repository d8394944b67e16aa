"""Refine inverse depth between the planes of a sweep by Gauss-Newton steps on the gray values around each pixel.

Every neighboring image is warped by the current depth. The remaining difference and the slope of the gray values along
the epipolar line give a better depth. They also give its information, which is almost zero on a bare wall. A window is
warped by the depths of all its pixels. The depths are smoothed first, because depth jumps would tear the window.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit

Float32 = NDArray[np.float32]

_MOMENTS = 10
_LEAST_ALIKE = 0.3
_NOWHERE = -1.0  # value of unknown pixels, outside the range of the filter for any inverse depth


def smooth_depth(inverse: Float32, reach: float, tolerance: float) -> Float32:
    """`inverse` (H, W) float32, 1 / meters, 0 where unknown, after an edge-preserving filter (Tomasi and Manduchi,
    1998).

    It is the mean over the surrounding pixels without those that differ by much more than `tolerance` (1 / meters).
    `reach` is the standard deviation of the weights in pixels."""
    known = inverse > 0
    side = 2 * int(2 * reach + 0.5) + 1
    held = np.where(known, inverse, np.float32(_NOWHERE)).astype(np.float32)
    found: Float32 = np.where(known, cv2.bilateralFilter(held, side, tolerance, reach), 0).astype(np.float32)
    return found


def refine(
    reference: Float32,
    sources: list[Float32],
    rotations: NDArray[np.float64],
    shifts: NDArray[np.float64],
    found: Float32,
    window: int,
    longest: float,
    noise: float,
) -> tuple[Float32, Float32]:
    """One refinement step on `found` (H, W) float32, inverse depth in 1 / meters, 0 where unknown.

    reference  (H, W) float32, gray values, negative for pixels that must not be used
    sources    S arrays (H', W') float32, gray values of the neighboring images
    rotations, shifts  as in `nvsim.depth.sweep`
    window     side of the square around a pixel, pixels
    longest    largest step, 1 / meters
    noise      standard deviation of the gray values

    Returns two (H, W) float32 arrays: the refined inverse depth, and its inverse variance, meters squared.
    """
    push, curve = np.zeros(found.shape, np.float32), np.zeros(found.shape, np.float32)
    moments = np.empty((*found.shape, _MOMENTS), np.float32)
    tiny = noise * noise
    for gray, turned, shift in zip(sources, rotations, shifts, strict=True):
        _sample(reference, gray, turned, shift, found, moments)
        _add_image(np.asarray(cv2.blur(moments, (window, window)), np.float32), tiny, push, curve)
    return _apply_step(found, push, curve, longest, tiny), curve * np.float32(window * window / (2 * tiny))


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _interpolate(gray: Float32, p: float, q: float) -> float:
    """`gray` (H, W) interpolated at column p and row q, which must be inside."""
    x, y = int(p), int(q)
    right, below = min(x + 1, gray.shape[1] - 1), min(y + 1, gray.shape[0] - 1)
    a, b = p - x, q - y
    top = gray[y, x] + a * (gray[y, right] - gray[y, x])
    return float(top + b * (gray[below, x] + a * (gray[below, right] - gray[below, x]) - top))


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _sample(
    reference: Float32,
    gray: Float32,
    turned: NDArray[np.float64],
    shift: NDArray[np.float64],
    found: Float32,
    out: Float32,
) -> None:
    """Fill `out` (H, W, 10): whether the pixel is seen; its gray value in the reference and in the source; the slope in
    the source along the epipolar line per inverse depth; and the products of the last three."""
    height, width = found.shape
    wide, tall = gray.shape[1] - 1.0, gray.shape[0] - 1.0
    for y in range(height):
        for x in range(width):
            w = found[y, x]
            for c in range(_MOMENTS):
                out[y, x, c] = 0
            z = turned[2, 0] * x + turned[2, 1] * y + turned[2, 2] + w * shift[2]
            if w <= 0 or z < 1e-6:
                continue
            p = (turned[0, 0] * x + turned[0, 1] * y + turned[0, 2] + w * shift[0]) / z
            q = (turned[1, 0] * x + turned[1, 1] * y + turned[1, 2] + w * shift[1]) / z
            if p < 0 or q < 0 or p > wide or q > tall:
                continue
            du, dv = (shift[0] - p * shift[2]) / z, (shift[1] - q * shift[2]) / z
            length = np.sqrt(du * du + dv * dv) + 1e-6
            # The slope comes from two samples half a pixel to either side.
            hx, hy = 0.5 * du / length, 0.5 * dv / length
            ahead = _interpolate(gray, min(max(p + hx, 0.0), wide), min(max(q + hy, 0.0), tall))
            behind = _interpolate(gray, min(max(p - hx, 0.0), wide), min(max(q - hy, 0.0), tall))
            here, there, slope = reference[y, x], _interpolate(gray, p, q), (ahead - behind) * length
            if min(here, there, ahead, behind) < 0:
                continue
            out[y, x, 0] = 1
            out[y, x, 1] = here
            out[y, x, 2] = there
            out[y, x, 3] = slope
            out[y, x, 4] = here * here
            out[y, x, 5] = there * there
            out[y, x, 6] = slope * slope
            out[y, x, 7] = here * there
            out[y, x, 8] = slope * here
            out[y, x, 9] = slope * there


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _add_image(moments: Float32, tiny: float, push: Float32, curve: Float32) -> None:
    """Add the contribution of one image to `push` and `curve` (H, W), from the window means of `_sample`'s output."""
    height, width = push.shape
    for y in range(height):
        for x in range(width):
            share = moments[y, x, 0]
            if share < 0.5:
                continue
            scale = 1 / share
            mr, mt, ms = moments[y, x, 1] * scale, moments[y, x, 2] * scale, moments[y, x, 3] * scale
            vr = max(moments[y, x, 4] * scale - mr * mr, 0.0) + tiny
            vt = max(moments[y, x, 5] * scale - mt * mt, 0.0) + tiny
            alike = (moments[y, x, 7] * scale - mr * mt) / np.sqrt(vr * vt)
            if alike < _LEAST_ALIKE:
                continue
            gain = min(max(np.sqrt(vt / vr), 0.5), 2.0)
            weight = alike * alike
            curve[y, x] += weight * max(moments[y, x, 6] * scale - ms * ms, 0.0)
            push[y, x] += weight * (gain * (moments[y, x, 8] * scale - ms * mr) - (moments[y, x, 9] * scale - ms * mt))


@njit(cache=True, nogil=True, error_model="numpy")
def _apply_step(found: Float32, push: Float32, curve: Float32, longest: float, tiny: float) -> Float32:
    """`found` after its step. Steps are shorter where the images carry little information."""
    better = np.zeros_like(found)
    damping = 0.05 * tiny / (longest * longest) + 1e-9
    for y in range(found.shape[0]):
        for x in range(found.shape[1]):
            if found[y, x] > 0:
                step = push[y, x] / (curve[y, x] + damping)
                better[y, x] = max(found[y, x] + min(max(step, -longest), longest), 1e-4)
    return better
