"""Inverse depth between the planes of a sweep: Gauss-Newton on the grey values around each pixel.

Every neighbouring image is warped by the depth found so far; what differs still, and the slope of the grey values along
the epipolar line, give a better depth and say how much the images know about it: next to nothing on a bare wall.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


def refine(
    reference: Float32,
    sources: list[Float32],
    rotations: NDArray[np.float64],
    shifts: NDArray[np.float64],
    found: Float32,
    window: float,
    longest: float,
    noise: float,
) -> tuple[Float32, Float32, Float32]:
    """One step on `found` (H, W), inverse depth in 1 / metres, 0 where there is none.

    reference  (H, W) float32, grey values; sources S times (H', W')
    rotations, shifts  as in `nvsim.depth.sweep`
    window     standard deviation of the weights around a pixel, pixels
    longest    the step is at most so much, 1 / metres
    noise      of the grey values, standard deviation

    Returns three (H, W) float32: the better inverse depth; its inverse variance, metres squared; and the mean
    correlation of the windows, -1 where no source shows the place.
    """
    height, width = found.shape
    x = np.arange(width, dtype=np.float32)[None, :]
    y = np.arange(height, dtype=np.float32)[:, None]
    known = (found > 0).astype(np.float32)

    def mean(values: Float32) -> Float32:
        return np.asarray(cv2.GaussianBlur(values, (0, 0), window, borderType=cv2.BORDER_REFLECT), np.float32)

    curve = np.zeros((height, width), np.float32)
    push = np.zeros((height, width), np.float32)
    alike = np.zeros((height, width), np.float32)
    used = np.zeros((height, width), np.float32)
    tiny = np.float32(noise * noise)
    for grey, turned, shift in zip(sources, rotations.astype(np.float32), shifts.astype(np.float32), strict=True):
        z = turned[2, 0] * x + turned[2, 1] * y + turned[2, 2] + found * shift[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1 / z
            p = (turned[0, 0] * x + turned[0, 1] * y + turned[0, 2] + found * shift[0]) * scale
            q = (turned[1, 0] * x + turned[1, 1] * y + turned[1, 2] + found * shift[1]) * scale
        there = (z > 1e-6) & (p >= 0) & (q >= 0) & (p <= grey.shape[1] - 1) & (q <= grey.shape[0] - 1) & (found > 0)
        p, q, scale = np.where(there, p, 0), np.where(there, q, 0), np.where(there, scale, 0)
        warped = cv2.remap(grey, p, q, cv2.INTER_LINEAR)
        # The slope along the epipolar line, from two samples half a pixel apart on either side.
        du, dv = (shift[0] - p * shift[2]) * scale, (shift[1] - q * shift[2]) * scale
        length = np.sqrt(du * du + dv * dv) + np.float32(1e-6)
        hx, hy = np.float32(0.5) * du / length, np.float32(0.5) * dv / length
        ahead = cv2.remap(grey, p + hx, q + hy, cv2.INTER_LINEAR)
        slope = (ahead - cv2.remap(grey, p - hx, q - hy, cv2.INTER_LINEAR)) * length
        m = there.astype(np.float32)
        share = mean(m)
        inverse = 1 / np.maximum(share, np.float32(1e-3))
        mr, mt, ms = mean(m * reference) * inverse, mean(m * warped) * inverse, mean(m * slope) * inverse
        vr = mean(m * reference * reference) * inverse - mr * mr
        vt = mean(m * warped * warped) * inverse - mt * mt
        vs = mean(m * slope * slope) * inverse - ms * ms
        cov = mean(m * reference * warped) * inverse - mr * mt
        sr = mean(m * slope * reference) * inverse - ms * mr
        st = mean(m * slope * warped) * inverse - ms * mt
        correlation = cov / np.sqrt((np.maximum(vr, 0) + tiny) * (np.maximum(vt, 0) + tiny))
        gain = np.sqrt(np.clip((vt + tiny) / (vr + tiny), 0.25, 4.0))
        good = there & (correlation > 0.3) & (share > 0.5)
        weight = np.where(good, correlation * correlation, 0).astype(np.float32)
        curve += weight * np.maximum(vs, 0)
        push += weight * (gain * sr - st)
        alike += np.where(good, correlation, 0)
        used += good
    step = push / (curve + tiny / np.float32(longest * longest) * np.float32(0.05) + np.float32(1e-9))
    better = np.where(known > 0, np.maximum(found + np.clip(step, -longest, longest), 1e-4), 0).astype(np.float32)
    area = 4 * np.pi * window * window
    return better, (curve * np.float32(area / (2 * noise * noise))), np.where(used > 0, alike / np.maximum(used, 1), -1)
