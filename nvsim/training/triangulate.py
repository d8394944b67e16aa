"""A sparse cloud from the images themselves: SIFT features of neighbouring views, matched and triangulated with known
poses. For captures that bring no cloud."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.training.views import TrainingView

FEATURES = 2000
"""Most features of a view."""
PARTNERS = 3
"""Each view is matched with this many of the views after it that see the same from another place."""
BASELINE = (0.08, 3.0)
"""Metres between two matched views."""
LARGEST_TURN = np.radians(35)
RATIO = 0.8
"""Lowe's ratio of the best to the second best match."""
REPROJECTION = 1.5
"""Most pixels between a feature and its point drawn back."""
LEAST_PARALLAX = np.radians(1.5)
NEAREST, FARTHEST = 0.2, 20.0
"""Metres along the optical axis."""
_FEW = 8
Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Features:
    pixels: Float64
    descriptors: NDArray[np.float32]


def triangulated_cloud(views: Sequence[TrainingView]) -> Cloud:
    """A cloud of kind "sfm", empty where nothing matches."""
    detector = cv2.SIFT.create(nfeatures=FEATURES)
    features = [_features(view, detector) for view in views]
    points, colors = [np.zeros((0, 3), np.float32)], [np.zeros((0, 3), np.uint8)]
    for i, j in _pairs(views):
        found, pixels = _triangulate(views[i], views[j], features[i], features[j])
        columns, rows = pixels.astype(np.int64).T
        points.append(found.astype(np.float32))
        colors.append(views[i].image[rows, columns])
    return Cloud(np.concatenate(points), np.concatenate(colors), "sfm")


def _features(view: TrainingView, detector: cv2.SIFT) -> _Features:
    keypoints, descriptors = detector.detectAndCompute(cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY), None)
    if descriptors is None:
        return _Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    # OpenCV counts from the centre of the first pixel, we from its corner.
    pixels = np.array([k.pt for k in keypoints], np.float64) + 0.5
    return _Features(pixels, np.asarray(descriptors, np.float32))


def _pairs(views: Sequence[TrainingView]) -> list[tuple[int, int]]:
    positions = np.array([v.camera.position for v in views])
    axes = np.array([v.camera.rotation[:, 2] for v in views])
    pairs = []
    for i in range(len(views)):
        distance = np.linalg.norm(positions[i + 1 :] - positions[i], axis=1)
        turned = np.arccos(np.clip(axes[i + 1 :] @ axes[i], -1, 1))
        fits = (distance > BASELINE[0]) & (distance < BASELINE[1]) & (turned < LARGEST_TURN)
        candidates = np.flatnonzero(fits)
        nearest = candidates[np.argsort(distance[candidates], kind="stable")[:PARTNERS]]
        pairs += [(i, i + 1 + int(j)) for j in nearest]
    return pairs


def _triangulate(a: TrainingView, b: TrainingView, fa: _Features, fb: _Features) -> tuple[Float64, Float64]:
    """Points (N, 3) and their pixels (N, 2) in the first view."""
    nothing = np.zeros((0, 3)), np.zeros((0, 2))
    if len(fa.pixels) < _FEW or len(fb.pixels) < _FEW:
        return nothing
    matches = cv2.BFMatcher(cv2.NORM_L2).knnMatch(fa.descriptors, fb.descriptors, k=2)
    good = [m for m, n in matches if m.distance < RATIO * n.distance]
    if len(good) < _FEW:
        return nothing
    pa = fa.pixels[[m.queryIdx for m in good]]
    pb = fb.pixels[[m.trainIdx for m in good]]
    homogeneous = cv2.triangulatePoints(_projection(a), _projection(b), pa.T, pb.T)
    with np.errstate(divide="ignore", invalid="ignore"):
        points = np.asarray((homogeneous[:3] / homogeneous[3]).T, np.float64)
    keep = np.asarray(np.isfinite(points).all(axis=1))
    points = np.where(keep[:, None], points, 0)
    for view, pixels in ((a, pa), (b, pb)):
        drawn, depth = view.camera.project(points)
        keep = keep & (depth > NEAREST) & (depth < FARTHEST) & (np.linalg.norm(drawn - pixels, axis=1) < REPROJECTION)
    to_a, to_b = points - a.camera.position, points - b.camera.position
    lengths = np.linalg.norm(to_a, axis=1) * np.linalg.norm(to_b, axis=1)
    cosine = np.sum(to_a * to_b, axis=1) / np.maximum(lengths, 1e-12)
    keep = keep & (np.arccos(np.clip(cosine, -1, 1)) > LEAST_PARALLAX)
    return points[keep], pa[keep]


def _projection(view: TrainingView) -> Float64:
    k = view.camera.intrinsics
    matrix = np.array([[k.fx, 0, k.cx], [0, k.fy, k.cy], [0, 0, 1.0]])
    return matrix @ view.camera.world_to_camera[:3]
