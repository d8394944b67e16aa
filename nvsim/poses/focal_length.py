"""The focal length of a camera that nobody calibrated, from what pairs of its images have in common."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

USUAL = 0.78
"""Focal length of a phone's main camera at video, divided by the longer side of the image."""
_SHORTEST, _LONGEST, _TRIES = 0.38, 1.8, 180  # times the longer side
_PAIRS = 300  # that are enough
_FEWEST = 5  # fundamental matrices that say something
_PLANAR = 0.8  # of the inliers agree with a homography: a plane, or no parallax, and no word about the focal length


def estimate_focal_length(
    pairs: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]], width: int, height: int, prior: float | None
) -> float:
    """Pixels. `pairs` are matched places ((M, 2), (M, 2)) in two images each of one camera; `prior` is the focal length
    by EXIF, in pixels.

    One search over the focal length for which the fundamental matrices are most nearly essential: an essential matrix
    has two equal singular values (Hartley and Zisserman, Multiple View Geometry, 9.6.1). The usual focal length of a
    phone decides what the images leave open. Its own value is returned if too few pairs say something.
    """
    matrices: list[NDArray[np.float64]] = []
    for a, b in pairs:
        if len(matrices) >= _PAIRS:
            break
        if len(a) < 50:
            continue
        matrix = _fundamental_matrix(a, b)
        if matrix is not None:
            matrices.append(matrix)
    longer = max(width, height)
    expected = prior or USUAL * longer
    if len(matrices) < _FEWEST:
        return expected
    tries = longer * np.geomspace(_SHORTEST, _LONGEST, _TRIES)
    trust = 0.2 if prior else 0.02
    cost = trust * (np.log(tries / expected) / np.log(1.5)) ** 2
    center = np.array([[1, 0, width / 2], [0, 1, height / 2], [0, 0, 1.0]])
    centered = center.T @ np.array(matrices) @ center
    for k, focal in enumerate(tries):
        scaled = np.diag([focal, focal, 1.0])
        values = np.linalg.svd(scaled @ centered @ scaled, compute_uv=False)
        unequal = (values[:, 0] - values[:, 1]) / values[:, 0]
        cost[k] += np.mean(unequal**2 / (unequal**2 + 0.03**2))
    return float(tries[cost.argmin()])


def _fundamental_matrix(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """(3, 3) from matched places (M, 2); None where a plane, or no parallax, says nothing about the focal length."""
    try:
        matrix, good = cv2.findFundamentalMat(a, b, cv2.USAC_MAGSAC, 1.5, 0.999, 2000)
        _, flat = cv2.findHomography(a, b, cv2.USAC_MAGSAC, 2.0)
    except cv2.error:  # some degenerate sets of matches fail in an assertion
        return None
    if matrix is None or matrix.shape != (3, 3) or good.sum() < 40:
        return None
    return None if flat is not None and flat.sum() >= _PLANAR * good.sum() else np.asarray(matrix, np.float64)
