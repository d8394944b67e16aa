"""Moving the border of a mask to the edge that the image shows nearby."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nvsim.perception.roles import Float32, Image, Mask


@dataclass(frozen=True)
class RefineConfig:
    """reach     metres that the border may move, at the distance of what it borders on
    least     pixels that it may always move
    most      pixels that it may move at most
    """

    reach: float = 0.04
    least: float = 1.5
    most: float = 12.0


def refine(mask: Mask, scale: Float32, image: Image, config: RefineConfig) -> Mask:
    """(H, W) bool at the size of `image` (H, W, 3) uint8 from `mask` of any size: outside a band around the border the
    mask stays, inside it the border runs along the strongest edges (watershed from both sides).

    `scale`, of the size of `mask`, says how many pixels of the image a metre takes there.
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
    fine: Mask = (markers == 1) | ((markers <= 0) & large)
    return fine
