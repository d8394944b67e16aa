"""Grows regions from points on the normal map: the prompted role without a network, and the tool with which users
correct a mask by clicks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.perception.roles import Float32, Image, Mask

_PATCH = 2  # pixels around a point in which its normal and color are measured
_ANGLE = 15.0  # degrees: a pixel belongs to a point's surface if the angle between their normals is smaller
_COLOR = 22.0  # levels of 255: greatest color difference from the point, used if it has no normal
_HOLE = 0.0006  # holes of a region smaller than this share of the image are filled


class RegionGrowing:
    """A PromptedMask: the surfaces at the points, found with the normal map alone."""

    def mask(self, picture: Image, points: NDArray[np.floating], camera: Camera) -> Mask:
        """The surfaces (H, W) bool at the `points` (K, 2) on the normal map `picture` (H, W, 3), see PromptedMask."""
        normals = picture.astype(np.float32) / 127.5 - 1.0
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        normals = np.where(length > 0.5, normals / np.maximum(length, 1e-6), 0).astype(np.float32)
        return grow_region(normals, picture, points, np.ones(len(points), bool))


def grow_region(
    normals: Float32,
    image: Image,
    points: NDArray[np.floating],
    inside: NDArray[np.bool_],
) -> Mask:
    """(H, W) bool: the connected surfaces at the `points` (K, 2), x, y in pixels, that are `inside` (K,) bool, without
    those at the other points. If points of both kinds are on one surface, it is split along the strongest edges of
    `image` (H, W, 3) uint8 between them (watershed).

    `normals` (H, W, 3) are unit vectors, zero if unknown. From a point without a normal the region grows over similar
    colors. Points outside the image are moved to its border.
    """
    import cv2

    height, width = image.shape[:2]
    cells = np.clip(np.floor(np.asarray(points, float).reshape(-1, 2)), 0, [width - 1, height - 1]).astype(int)
    wanted, unwanted = np.zeros((height, width), bool), np.zeros((height, width), bool)
    for (x, y), positive in zip(cells, inside, strict=True):
        region = _surface(normals, image, int(x), int(y))
        if positive:
            wanted |= region
        else:
            unwanted |= region
    contested = wanted & unwanted
    result = wanted & ~unwanted
    if contested.any():
        markers = np.zeros((height, width), np.int32)
        markers[~contested] = 3
        for (x, y), positive in zip(cells, inside, strict=True):
            cv2.circle(markers, (int(x), int(y)), _PATCH, 1 if positive else 2, -1)
        # The contested surface gets a border of another brightness, so that the watershed cannot enter from outside.
        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0))
        smooth[~contested] = 0 if smooth[contested].mean() > 127 else 255
        cv2.watershed(smooth, markers)
        result |= contested & _widen_region(markers == 1, markers == -1)
    return _fill_small_holes(result, _HOLE)


def _surface(normals: Float32, image: Image, x: int, y: int) -> Mask:
    """The connected pixels around one point with a similar normal, or a similar color if the point has no normal."""
    import cv2

    height, width = image.shape[:2]
    around = slice(max(0, y - _PATCH), y + _PATCH + 1), slice(max(0, x - _PATCH), x + _PATCH + 1)
    mean = normals[around].reshape(-1, 3).mean(axis=0)
    if np.linalg.norm(normals[y, x]) > 0.5:
        # Beside an edge, only the neighbors on the point's own side count.
        patch = normals[around].reshape(-1, 3)
        mean = patch[patch @ normals[y, x] > np.cos(np.radians(_ANGLE))].mean(axis=0)
        alike = normals @ (mean / np.linalg.norm(mean)) > np.cos(np.radians(_ANGLE))
    else:
        color = image[around].reshape(-1, 3).mean(axis=0)
        alike = (np.abs(image - color.astype(np.float32)) < _COLOR).all(axis=-1)
    alike[y, x] = True
    _, labels = cv2.connectedComponents(alike.astype(np.uint8), connectivity=4)
    region: Mask = labels == labels[y, x]
    return region


def _widen_region(region: Mask, border: Mask) -> Mask:
    """`region` with the adjacent one-pixel lines of the watershed."""
    import cv2

    wide: Mask = region | ((cv2.dilate(region.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & border)
    return wide


def _fill_small_holes(mask: Mask, share: float) -> Mask:
    """`mask` without small holes."""
    import cv2

    _, labels, stats, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < share * mask.size
    small[0] = False
    filled: Mask = mask | small[labels]
    return filled
