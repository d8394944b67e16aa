"""Agreement between depth maps: a depth is confirmed if the maps of other views have a similar depth at its point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.depth.view import Warp
from nvsim.kernels import njit

Float32 = NDArray[np.float32]


@njit(cache=True, nogil=True, error_model="numpy")
def _compare(
    found: Float32,
    other: Float32,
    weight: Float32,
    turned: NDArray[np.float64],
    shift: NDArray[np.float64],
    back: NDArray[np.float64],
    share: float,
    plane: float,
    mass: Float32,
    total: Float32,
    views: NDArray[np.uint8],
    through: NDArray[np.uint8],
) -> None:
    """Compare `found` (H, W) with `other` (H', W') and its `weight`; adds the result to the four (H, W) outputs."""
    height, width = found.shape
    tall, wide = other.shape
    for y in range(height):
        for x in range(width):
            w = found[y, x]
            if w <= 0:
                continue
            z = turned[2, 0] * x + turned[2, 1] * y + turned[2, 2] + w * shift[2]
            if z <= 1e-6:
                continue
            p = (turned[0, 0] * x + turned[0, 1] * y + turned[0, 2] + w * shift[0]) / z
            q = (turned[1, 0] * x + turned[1, 1] * y + turned[1, 2] + w * shift[1]) / z
            if p < -0.5 or q < -0.5 or p >= wide - 0.5 or q >= tall - 0.5:
                continue
            u, v = int(p + 0.5), int(q + 0.5)
            there = other[v, u]
            if there <= 0:
                continue
            expected = w / z
            allowed = share * expected + plane
            if abs(there - expected) < allowed:
                here = (back[0] * p + back[1] * q + back[2]) / there + back[3]
                if here > 0:
                    mass[y, x] += weight[v, u]
                    total[y, x] += weight[v, u] / here
                    views[y, x] += 1
            elif there < expected - 2 * allowed:
                through[y, x] += 1


@dataclass(frozen=True, eq=False)
class AgreedDepth:
    """inverse  (H, W) float32, 1 / meters: weighted mean of the depths that agree, 0 where unknown
    weight   (H, W) float32, sum of the weights of these depths
    views    (H, W) uint8, number of other maps that agree
    through  (H, W) uint8, number of maps that see through the point
    """

    inverse: Float32
    weight: Float32
    views: NDArray[np.uint8]
    through: NDArray[np.uint8]


def compare_depth_maps(
    found: Float32,
    weight: Float32,
    others: list[tuple[Float32, Float32, Warp]],
    share: float,
    plane: float,
) -> AgreedDepth:
    """Compare an inverse depth map `found` (H, W) and its `weight` (H, W) with the maps of other views.

    `others` holds the inverse depth map, the weights, and the warp to each other view. Two depths agree if their
    difference is less than `share` of the inverse depth plus `plane` (1 / meters)."""
    mass = weight + np.float32(1e-3)
    total = mass * found
    views, through = np.zeros(found.shape, np.uint8), np.zeros(found.shape, np.uint8)
    for other, its, warp in others:
        _compare(
            found,
            other,
            its + np.float32(1e-3),
            warp.turned,
            warp.shift,
            warp.back,
            share,
            plane,
            mass,
            total,
            views,
            through,
        )
    return AgreedDepth(total / mass, mass, views, through)
