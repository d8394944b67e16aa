"""Triangulate points from images with known poses, by matching SIFT features, for training and to find the floor.

Two images are matched in any unit.

The points of a capture are enough to estimate the up direction and the camera height. A sample of images is matched
with nearby images. The unit is unknown, so partners are chosen by rank among images with a similar viewing direction:
the second, eighth, and 24th nearest. Only points with enough parallax are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.capture.masks import usable_pixels
from nvsim.capture.raw import RawFrame
from nvsim.capture.types import Frame
from nvsim.errors import InputError
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


_PLACES = 30  # images for which partners are searched
_RANKS = (2, 8, 24)
_TURN = np.cos(np.radians(35))
_PARALLAX = float(np.radians(4))  # between cameras; points with less scatter by more than the floor's thickness
_SIZE = 640  # pixels
_THREADS = 2


def read_view(raw: RawFrame, longest_side: int) -> tuple[Camera, NDArray[np.uint8], NDArray[np.bool_] | None] | None:
    """The camera of an image that has a pose and a lens, with at most `longest_side` pixels on its longer side, the
    undistorted image (H, W, 3) uint8 RGB, and its usable pixels (H, W), None for all. None if it cannot be read: the
    stage that needs the image reports the error."""
    assert raw.lens is not None and raw.camera_to_world is not None
    frame = Frame(raw.name, raw.image_path, raw.lens, raw.camera_to_world, raw.sensor, raw.timestamp, raw.mask)
    k = frame.intrinsics.limited_to(longest_side)
    try:
        return frame.camera.scaled(k.width, k.height), read_image(frame, k), usable_pixels(frame, k)
    except InputError:
        return None


def image_points(frames: Sequence[RawFrame]) -> NDArray[np.float64]:
    """(N, 3) float64 points in the unit and frame of the source. Images that cannot be read are skipped."""
    usable = [f for f in frames if f.camera_to_world is not None and f.lens is not None]
    poses = np.array([f.camera_to_world for f in usable]).reshape(-1, 4, 4)
    pairs = _pairs(poses)
    wanted = sorted({i for pair in pairs for i in pair})

    def features(index: int) -> Features | None:
        view = read_view(usable[index], _SIZE)
        return None if view is None else Features.of(*view)

    with ThreadPoolExecutor(_THREADS) as pool:
        found = dict(zip(wanted, pool.map(features, wanted), strict=True))

        def points(pair: tuple[int, int]) -> NDArray[np.float64]:
            a, b = found[pair[0]], found[pair[1]]
            return np.zeros((0, 3)) if a is None or b is None else triangulate(a, b, _PARALLAX)[0]

        return np.concatenate([np.zeros((0, 3)), *pool.map(points, pairs)])


def _pairs(poses: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Index pairs into poses (N, 4, 4) of the images to match."""
    places, axes = poses[:, :3, 3], poses[:, :3, 2]
    pairs = []
    for i in np.unique(np.linspace(0, len(poses) - 1, min(_PLACES, len(poses))).astype(int)):
        distance = np.linalg.norm(places - places[i], axis=1)
        fits = np.flatnonzero((axes @ axes[i] > _TURN) & (distance > 0))
        order = fits[np.argsort(distance[fits], kind="stable")]
        pairs += [(int(i), int(order[rank])) for rank in _RANKS if rank < len(order)]
    return pairs
