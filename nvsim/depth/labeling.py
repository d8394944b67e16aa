"""Assign pixels to planes of the building, for bare walls and floors whose pixels match almost any other pixel.

Every plane maps one image onto another by a homography. A plane is therefore scored like a depth: by the census
distance in the best two neighboring images, and by confirmed depths. A change of plane between pixels has a cost, which
is lower at image edges (piecewise planar stereo: Sinha, Steedly and Szeliski, 2009).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.depth.config import LabelConfig
from nvsim.depth.planes import Plane
from nvsim.depth.smoothing import smooth_cost
from nvsim.depth.sweep import plane_costs
from nvsim.depth.view import View, Warp, matrix_of
from nvsim.geometry.camera import Camera
from nvsim.kernels import njit

Float32 = NDArray[np.float32]
_LEVEL = 0.9  # upward part of a normal


def label_planes(
    view: View,
    sources: list[View],
    warps: list[Warp],
    confirmed: Float32,
    planes: list[Plane],
    config: LabelConfig,
) -> tuple[Float32, NDArray[np.int16]]:
    """Inverse depth (H, W) float32, 1 / meters, 0 where unknown; and the index of each pixel's plane (H, W) int16, -1
    for none.

    `confirmed` (H, W) float32 holds the inverse depth that other views confirmed, 0 elsewhere."""
    chosen = _visible(view.camera, planes, config)
    nothing = np.full(confirmed.shape, -1, np.int16)
    if not chosen or not sources:
        return confirmed, nothing
    forms = np.stack([planes[i].in_pixels(view.camera) for i in chosen])
    turned, shifts = np.stack([w.turned for w in warps]), np.stack([w.shift for w in warps])
    photo = plane_costs(view.census, [s.census for s in sources], turned, shifts, forms)
    for plane in photo:
        cv2.blur(plane, (config.window, config.window), dst=plane)
    extents = np.stack([_extent(planes[i], view.camera) for i in chosen])
    limits = np.stack([np.concatenate([planes[i].low, planes[i].high]) for i in chosen])
    prior = np.array([_prior(planes[i], config) for i in chosen])
    cost = np.empty((*confirmed.shape, len(chosen) + 1), np.uint8)
    far = 1 / config.farthest
    usual = max(_usual_image_difference(photo, confirmed, forms, config.tolerance, far) - config.usual_difference, 0.0)
    rule = (
        far,
        config.tolerance,
        config.difference_cost,
        config.max_difference_cost,
        config.unexplained_cost + usual,
        config.unknown_cost + usual,
    )
    _fill(photo, confirmed, forms, extents, limits, prior, rule, cost)
    total = smooth_cost(cost, view.gray, int(config.change_cost), config.change_cost, config.edge_step)
    return _choose_labels(total, confirmed, forms, np.asarray(chosen, np.int16), far)


def _prior(plane: Plane, config: LabelConfig) -> float:
    """The cost of a plane that does not depend on the images."""
    if plane.normal[2] > _LEVEL:
        return config.floor_cost
    return config.small_plane_cost / (1 + plane.area / config.half_cost_area)


@njit(cache=True, nogil=True, error_model="numpy")
def _usual_image_difference(
    photo: NDArray[np.uint8], confirmed: Float32, forms: NDArray[np.float64], share: float, far: float
) -> float:
    """The usual image difference here on a correct plane; 0 if confirmed depths support no plane.

    It is the mean cost of planes at pixels whose confirmed depth is on them. Noise, blur, and fine texture raise it."""
    height, width = confirmed.shape
    total, count = 0.0, 0
    for y in range(height):
        for x in range(width):
            known = confirmed[y, x]
            if known <= 0:
                continue
            for k in range(len(forms)):
                w = forms[k, 0] * x + forms[k, 1] * y + forms[k, 2]
                if w > far and abs(w - known) < share * known:
                    total += 0.5 * photo[k, y, x]
                    count += 1
                    break
    return total / count if count > 100 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(
    photo: NDArray[np.uint8],
    confirmed: Float32,
    forms: NDArray[np.float64],
    extents: NDArray[np.float64],
    limits: NDArray[np.float64],
    prior: NDArray[np.float64],
    rule: tuple[float, float, float, float, float, float],
    cost: NDArray[np.uint8],
) -> None:
    """Fill `cost` (H, W, L + 1): no plane first, then each of L planes. `photo` (L, H, W); `forms` (L, 3) as in
    `plane_costs`; `extents` (L, 2, 4) from `_extent`; `limits` (L, 4) low and high of the planes."""
    height, width = confirmed.shape
    far, share, differ, worst, own, unknown = rule
    for y in range(height):
        for x in range(width):
            known = confirmed[y, x]
            cost[y, x, 0] = np.uint8(own if known > 0 else unknown)
            for k in range(len(forms)):
                w = forms[k, 0] * x + forms[k, 1] * y + forms[k, 2]
                cost[y, x, k + 1] = np.uint8(60)
                if w < far:
                    continue
                e = extents[k]
                a = e[0, 3] + (e[0, 0] * x + e[0, 1] * y + e[0, 2]) / w
                b = e[1, 3] + (e[1, 0] * x + e[1, 1] * y + e[1, 2]) / w
                if a < limits[k, 0] or b < limits[k, 1] or a > limits[k, 2] or b > limits[k, 3]:
                    continue
                value = 0.5 * photo[k, y, x] + prior[k]
                if known > 0:
                    value += min(abs(w - known) / (share * known + 0.004) * differ, worst)
                cost[y, x, k + 1] = np.uint8(min(value, 60.0))


@njit(cache=True, nogil=True, error_model="numpy")
def _choose_labels(
    total: NDArray[np.int16], confirmed: Float32, forms: NDArray[np.float64], chosen: NDArray[np.int16], far: float
) -> tuple[Float32, NDArray[np.int16]]:
    """The inverse depth of the label with the lowest `total` (H, W, L + 1), and the index of its plane."""
    height, width, labels = total.shape
    found = confirmed.copy()
    which = np.full((height, width), -1, np.int16)
    for y in range(height):
        for x in range(width):
            best = 0
            for k in range(1, labels):
                if total[y, x, k] < total[y, x, best]:
                    best = k
            if best > 0:
                w = forms[best - 1, 0] * x + forms[best - 1, 1] * y + forms[best - 1, 2]
                if w > far:
                    found[y, x] = w
                    which[y, x] = chosen[best - 1]
    return found, which


def _extent(plane: Plane, camera: Camera) -> NDArray[np.float64]:
    """(2, 4) coefficients of the intersection of a pixel's ray with the plane, along the plane's two axes.

    For pixel index (x, y) at inverse depth w: the last number plus the first three @ (x, y, 1) / w."""
    out = np.linalg.inv(matrix_of(camera))
    axes = np.stack([plane.along, plane.up])
    return np.concatenate([axes @ camera.rotation @ out, (axes @ camera.position)[:, None]], axis=1)


def _inside(plane: Plane, points: NDArray[np.floating]) -> NDArray[np.bool_]:
    a, b = points @ plane.along.astype(np.float32), points @ plane.up.astype(np.float32)
    low, high = plane.low, plane.high
    inside: NDArray[np.bool_] = (a > low[0]) & (a < high[0]) & (b > low[1]) & (b < high[1])
    return inside


def _visible(camera: Camera, planes: list[Plane], config: LabelConfig) -> list[int]:
    """The planes that cover most of the image, without regard to occlusion."""
    small = camera.scaled(40, 30)
    rays = small.rays().reshape(-1, 3)
    shares = []
    for i, plane in enumerate(planes):
        distance = plane.offset - float(plane.normal @ camera.position)
        if distance > -0.05:  # seen from its back
            shares.append((0.0, i))
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            along = distance / (rays @ plane.normal)
            points = camera.position + along[:, None] * rays
            hit = (along > 0.05) & (along < config.farthest) & _inside(plane, points)
        shares.append((float(hit.mean()), i))
    order = sorted((s for s in shares if s[0] > 0.002), key=lambda s: (-s[0], s[1]))
    return [i for _, i in order[: config.max_planes]]
