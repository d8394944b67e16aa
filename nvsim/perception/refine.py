"""Moves the border of a mask to a nearby edge of the image, and its pixels to the side with their color."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nvsim.perception.roles import Float32, Image, Mask

_AROUND = 5  # pixels: side of the square around a border pixel in which the mean colors of both sides are computed


@dataclass(frozen=True)
class RefineConfig:
    """reach     meters that the border can move, at the distance of the nearest surface
    least     pixels that it can always move
    most      greatest number of pixels that it can move
    """

    reach: float = 0.04
    least: float = 1.5
    most: float = 12.0


def refine(mask: Mask, scale: Float32, image: Image, config: RefineConfig) -> Mask:
    """(H, W) bool at the size of `image` (H, W, 3) uint8, from a `mask` (h, w) of any size.

    Outside a band around the border the mask is unchanged. In the band, the border follows the strongest edges
    (watershed from both sides). The pixels on the border itself get the side that has their color.

    `scale` (h, w), of the size of `mask`, is the number of pixels of the image per meter.
    """
    import cv2

    height, width = image.shape[:2]
    large = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR) > 0.5
    if config.most < 1 or large.all() or not large.any():
        coarse: Mask = large
        return coarse
    reach = cv2.resize(config.reach * scale, (width, height), interpolation=cv2.INTER_LINEAR)
    reach = np.clip(reach, config.least, config.most)
    inside = cv2.distanceTransform(large.astype(np.uint8), cv2.DIST_L2, 3)
    outside = cv2.distanceTransform((~large).astype(np.uint8), cv2.DIST_L2, 3)
    markers = np.zeros((height, width), np.int32)
    markers[inside > reach] = 1
    markers[outside > reach] = 2
    cv2.watershed(cv2.GaussianBlur(image, (0, 0), 1.0), markers)
    return _by_color((markers == 1) | ((markers <= 0) & large), image)


def _by_color(mask: Mask, image: Image) -> Mask:
    """`mask` (H, W) with each border pixel on the side whose mean color nearby is closer to its own. Colors are from
    `image` (H, W, 3) uint8; the means leave out the border. An edge is one or two pixels wide, and a watershed ends
    anywhere in it."""
    import cv2

    floor, block = mask.astype(np.uint8), np.ones((3, 3), np.uint8)
    sides = cv2.erode(floor, block), cv2.erode(1 - floor, block)
    band = np.maximum(*sides) == 0
    own = image[band].astype(np.float32)
    off = np.empty((2, len(own)), np.float32)
    for k, side in enumerate(sides):
        number, colors = (
            cv2.boxFilter(layer, cv2.CV_16U, (_AROUND, _AROUND), normalize=False, borderType=cv2.BORDER_CONSTANT)[band]
            for layer in (side, image * side[..., None])
        )
        mean = colors / np.maximum(number, 1).astype(np.float32)[:, None]
        off[k] = np.where(number > 0, ((own - mean) ** 2).sum(axis=1), np.inf)
    fine = mask.copy()
    known = np.isfinite(off).all(axis=0)
    fine[band] = np.where(known, off[0] < off[1], mask[band])
    return fine
