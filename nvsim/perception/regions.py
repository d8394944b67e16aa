"""Growing a region from points on the map of surface normals: the prompted role without a network, and what a user's
clicks give while correcting a mask."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.perception.roles import Float32, Image, Mask

_PATCH = 2  # pixels around a point from which its normal and colour are taken


@dataclass(frozen=True)
class RegionConfig:
    """angle  degrees: a pixel belongs to a point's surface when its normal turns from the point's by less
    color  levels of 255: where no normal is known, how far a colour may be from the point's
    hole   holes of a region smaller than this share of the image are filled
    """

    angle: float = 15.0
    color: float = 22.0
    hole: float = 0.0006


@dataclass(frozen=True)
class RegionGrowing:
    """A PromptedMask: the surfaces that the points lie on. Needs nothing but the normal map."""

    config: RegionConfig = RegionConfig()

    def mask(self, picture: Image, points: NDArray[np.floating], camera: Camera) -> Mask:
        normals = picture.astype(np.float32) / 127.5 - 1.0
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        normals = np.where(length > 0.5, normals / np.maximum(length, 1e-6), 0).astype(np.float32)
        return grow_region(normals, picture, points, np.ones(len(points), bool), self.config)


def grow_region(
    normals: Float32,
    image: Image,
    points: NDArray[np.floating],
    inside: NDArray[np.bool_],
    config: RegionConfig | None = None,
) -> Mask:
    """(H, W) bool: the connected surfaces around the `points` (K, 2) x, y in pixels that are `inside` (K,), without
    those around the others. Where points of both kinds lie on one surface, each takes its side of the strongest edges
    of `image` (H, W, 3) uint8 between them (watershed).

    `normals` (H, W, 3) are unit vectors, zero where nothing is known; from a point without a normal the region grows
    over similar colours instead. Points outside the image are moved to its border.
    """
    import cv2

    config = config or RegionConfig()
    height, width = image.shape[:2]
    cells = np.clip(np.floor(np.asarray(points, float).reshape(-1, 2)), 0, [width - 1, height - 1]).astype(int)
    wanted, unwanted = np.zeros((height, width), bool), np.zeros((height, width), bool)
    for (x, y), positive in zip(cells, inside, strict=True):
        region = _surface(normals, image, int(x), int(y), config)
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
        # Around the contested surface stands a wall of another brightness, so that nothing floods in from there.
        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0))
        smooth[~contested] = 0 if smooth[contested].mean() > 127 else 255
        cv2.watershed(smooth, markers)
        result |= contested & _widened(markers == 1, markers == -1)
    return _filled(result, config.hole)


def _surface(normals: Float32, image: Image, x: int, y: int, config: RegionConfig) -> Mask:
    """The connected pixels around one point that are alike."""
    import cv2

    height, width = image.shape[:2]
    around = slice(max(0, y - _PATCH), y + _PATCH + 1), slice(max(0, x - _PATCH), x + _PATCH + 1)
    mean = normals[around].reshape(-1, 3).mean(axis=0)
    if np.linalg.norm(normals[y, x]) > 0.5:
        # A point beside an edge speaks for its own side.
        patch = normals[around].reshape(-1, 3)
        mean = patch[patch @ normals[y, x] > np.cos(np.radians(config.angle))].mean(axis=0)
        alike = normals @ (mean / np.linalg.norm(mean)) > np.cos(np.radians(config.angle))
    else:
        color = image[around].reshape(-1, 3).mean(axis=0)
        alike = (np.abs(image - color.astype(np.float32)) < config.color).all(axis=-1)
    alike[y, x] = True
    _, labels = cv2.connectedComponents(alike.astype(np.uint8), connectivity=4)
    region: Mask = labels == labels[y, x]
    return region


def _widened(region: Mask, border: Mask) -> Mask:
    """`region` with the one-pixel lines of the watershed beside it."""
    import cv2

    wide: Mask = region | ((cv2.dilate(region.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & border)
    return wide


def _filled(mask: Mask, share: float) -> Mask:
    """`mask` without small holes."""
    import cv2

    _, labels, stats, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < share * mask.size
    small[0] = False
    filled: Mask = mask | small[labels]
    return filled
