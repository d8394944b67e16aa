"""Grows the small floor regions that a sparse cloud confirms into the similar-looking floor around them."""

from __future__ import annotations

import numpy as np

from nvsim.perception.roles import Image, Mask

_LEAST = 40  # pixels of floor needed to learn colors
_ROUNDS = 3


def grow(confirmed: Mask, possible: Mask, image: Image) -> Mask:
    """(h, w) bool: floor by GrabCut. `confirmed` (h, w) bool is floor, pixels that are not `possible` (h, w) bool are
    not. `image` is (h, w, 3) uint8 RGB. Only regions that contain confirmed floor are kept."""
    import cv2

    seeds = confirmed & possible
    if seeds.sum() < _LEAST or not (~possible).any():
        return seeds
    labels = np.full(image.shape[:2], cv2.GC_BGD, np.uint8)
    labels[possible] = cv2.GC_PR_BGD
    near = cv2.dilate(seeds.astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
    labels[possible & near] = cv2.GC_PR_FGD
    labels[cv2.erode(seeds.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0] = cv2.GC_FGD
    if not (labels == cv2.GC_FGD).any():
        return seeds
    cv2.setRNGSeed(0)  # GrabCut's first clusters are random
    models = np.zeros((1, 65)), np.zeros((1, 65))
    found, *_ = cv2.grabCut(image, labels, (0, 0, 1, 1), *models, _ROUNDS, cv2.GC_INIT_WITH_MASK)
    grown = ((found == cv2.GC_FGD) | (found == cv2.GC_PR_FGD)) & possible
    _, regions = cv2.connectedComponents(grown.astype(np.uint8))
    held = np.unique(regions[seeds & grown])
    kept: Mask = np.isin(regions, held[held > 0])
    return kept
