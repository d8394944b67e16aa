"""Estimate the focal length of an uncalibrated camera from pairs of its images."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

USUAL = 0.78
"""Focal length of a phone's main camera at video, divided by the longer side of the image."""
_SHORTEST, _LONGEST, _TRIES = 0.38, 1.8, 180  # times the longer side; number of tested focal lengths
_PAIRS = 300  # pairs that are used, at most
_FEWEST = 5  # fundamental matrices that are needed
_PLANAR = 0.8  # share of inliers that agree with a homography: a plane or no parallax, so the focal length is open


def estimate_focal_length(
    pairs: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]], width: int, height: int, prior: float | None
) -> float:
    """Estimates the focal length in pixels.

    `pairs` are matched pixels ((M, 2), (M, 2)) of two images of the same camera. `prior` is the focal length from EXIF,
    in pixels. The search selects the focal length for which the fundamental matrices are closest to essential matrices.
    An essential matrix has two equal singular values (Hartley and Zisserman, Multiple View Geometry, 9.6.1). A prior
    term prefers `prior` or the usual focal length of a phone. That value is returned if too few pairs are usable.
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
    """(3, 3) from matched pixels (M, 2). None if a plane or missing parallax leaves the focal length open."""
    try:
        matrix, good = cv2.findFundamentalMat(a, b, cv2.USAC_MAGSAC, 1.5, 0.999, 2000)
        _, flat = cv2.findHomography(a, b, cv2.USAC_MAGSAC, 2.0)
    except cv2.error:  # some degenerate sets of matches fail in an assertion
        return None
    if matrix is None or matrix.shape != (3, 3) or good.sum() < 40:
        return None
    return None if flat is not None and flat.sum() >= _PLANAR * good.sum() else np.asarray(matrix, np.float64)
