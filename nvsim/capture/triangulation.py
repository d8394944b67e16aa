"""Triangulate points from two images with known poses, by matching SIFT features. Works in any unit."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera

FEATURES = 2000
"""Maximum number of features per image."""
RATIO = 0.8
"""Lowe's ratio of the best to the second-best match distance."""
REPROJECTION = 1.5
"""Maximum distance in pixels between a feature and its reprojected point."""
LEAST_PARALLAX = float(np.radians(1.5))
_FEW = 8
_BORDER = 9  # pixels eroded around masked areas, because mask edges are not features of the building
Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Features:
    """camera       of the image
    pixels       (N, 2) float64
    descriptors  (N, 128) float32
    """

    camera: Camera
    pixels: Float64
    descriptors: NDArray[np.float32]

    @staticmethod
    def of(camera: Camera, image: NDArray[np.uint8], usable: NDArray[np.bool_] | None = None) -> Features:
        """The features of an undistorted `image` (H, W, 3) uint8 RGB of the size of `camera`. `usable` (H, W) bool
        selects the pixels to use, None for all."""
        detector = cv2.SIFT.create(nfeatures=FEATURES)
        mask = None if usable is None else cv2.erode(usable.astype(np.uint8), np.ones((_BORDER, _BORDER), np.uint8))
        keypoints, descriptors = detector.detectAndCompute(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), mask)
        if descriptors is None:
            return Features(camera, np.zeros((0, 2)), np.zeros((0, 128), np.float32))
        # OpenCV measures from the center of the first pixel, NVSim from its corner.
        pixels = np.array([k.pt for k in keypoints], np.float64) + 0.5
        return Features(camera, pixels, np.asarray(descriptors, np.float32))


def triangulate(a: Features, b: Features, parallax: float = LEAST_PARALLAX) -> tuple[Float64, Float64]:
    """(N, 3) float64 points in front of both cameras, and their (N, 2) float64 pixels in the first image.

    Only points with more than `parallax` radians between the two viewing rays are returned."""
    nothing = np.zeros((0, 3)), np.zeros((0, 2))
    if len(a.pixels) < _FEW or len(b.pixels) < _FEW:
        return nothing
    matches = cv2.BFMatcher(cv2.NORM_L2).knnMatch(a.descriptors, b.descriptors, k=2)
    good = [m for m, n in matches if m.distance < RATIO * n.distance]
    if len(good) < _FEW:
        return nothing
    pa = a.pixels[[m.queryIdx for m in good]]
    pb = b.pixels[[m.trainIdx for m in good]]
    homogeneous = cv2.triangulatePoints(_projection(a.camera), _projection(b.camera), pa.T, pb.T)
    with np.errstate(divide="ignore", invalid="ignore"):
        points = np.asarray((homogeneous[:3] / homogeneous[3]).T, np.float64)
    keep = np.asarray(np.isfinite(points).all(axis=1))
    points = np.where(keep[:, None], points, 0)
    for view, pixels in ((a, pa), (b, pb)):
        drawn, depth = view.camera.project(points)
        keep = keep & (depth > 0) & (np.linalg.norm(drawn - pixels, axis=1) < REPROJECTION)
    to_a, to_b = points - a.camera.position, points - b.camera.position
    lengths = np.linalg.norm(to_a, axis=1) * np.linalg.norm(to_b, axis=1)
    cosine = np.sum(to_a * to_b, axis=1) / np.maximum(lengths, 1e-12)
    keep = keep & (np.arccos(np.clip(cosine, -1, 1)) > parallax)
    return points[keep], pa[keep]


def _projection(camera: Camera) -> Float64:
    k = camera.intrinsics
    matrix = np.array([[k.fx, 0, k.cx], [0, k.fy, k.cy], [0, 0, 1.0]])
    return matrix @ camera.world_to_camera[:3]
