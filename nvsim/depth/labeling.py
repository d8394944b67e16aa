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


def _visible(camera: Camera, planes: list[Plane], config: LabelConfig) -> list[int]:
    """The planes that cover most of the image, without regard to occlusion."""
    if not planes:
        return []
    rays = camera.scaled(40, 30).rays().reshape(-1, 3)
    axes = np.array([(p.normal, p.along, p.up) for p in planes])
    limits = np.array([(*p.low, *p.high) for p in planes])
    offsets = np.array([p.offset for p in planes])
    shares = _shares_of_image(rays, camera.position, axes, offsets, limits, config.farthest)
    order = np.argsort(-shares, kind="stable")
    return [int(i) for i in order[: config.max_planes] if shares[i] > 0.002]


@njit(cache=True, nogil=True, error_model="numpy")
def _shares_of_image(
    rays: Float32,
    eye: NDArray[np.float64],
    axes: NDArray[np.float64],
    offsets: NDArray[np.float64],
    limits: NDArray[np.float64],
    farthest: float,
) -> NDArray[np.float64]:
    """(P,) the share of `rays` (R, 3) from `eye` (3,) that meet the front of each of P planes within `farthest` meters.

    `axes` (P, 3, 3) has the normal and the two axes of a plane; `limits` (P, 4) its low and high, as in `_fill`."""
    shares = np.zeros(len(axes))
    for k in range(len(axes)):
        normal, first, second = axes[k]
        distance = offsets[k] - (normal[0] * eye[0] + normal[1] * eye[1] + normal[2] * eye[2])
        if distance > -0.05:  # seen from its back
            continue
        for i in range(len(rays)):
            x, y, z = rays[i]
            along = distance / (normal[0] * x + normal[1] * y + normal[2] * z)
            if not 0.05 < along < farthest:
                continue
            x, y, z = eye[0] + along * x, eye[1] + along * y, eye[2] + along * z
            a, b = first[0] * x + first[1] * y + first[2] * z, second[0] * x + second[1] * y + second[2] * z
            if limits[k, 0] < a < limits[k, 2] and limits[k, 1] < b < limits[k, 3]:
                shares[k] += 1
    return shares / len(rays)
