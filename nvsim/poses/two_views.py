"""The relative pose of two images with known cameras, from their matches, and the focal length of an unknown camera.

A person who turns in place moves the camera by centimeters. The direction of so small a translation cannot be measured.
An essential matrix then fits a wrong direction with a rotation that is wrong by degrees. If a rotation alone explains
the matches, it is therefore the result. It also checks both coordinates of each match; an essential matrix checks one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

_ROTATED, _EPIPOLAR = 4.0, 2.0  # largest error of a match in pixels, in an image of 640 pixels
_ALONE = 0.8  # a rotation is the result if it explains this share of the matches that the essential matrix explains
_HYPOTHESES, _ROUNDS = 96, 6
_INLIERS = 20
_CALIBRATED = pycolmap.TwoViewGeometryConfiguration.CALIBRATED


@dataclass(frozen=True, eq=False)
class TwoViews:
    """rotation  (3, 3) float64, first to second camera
    matches   (M, 2) uint32, the matches that agree: keypoints of the first and of the second image
    turned    whether the rotation alone explains them, so that the translation is unknown
    geometry  the entry for a COLMAP database
    """

    rotation: NDArray[np.float64]
    matches: NDArray[np.uint32]
    turned: bool
    geometry: pycolmap.TwoViewGeometry


def rays_of(camera: pycolmap.Camera, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) unit vectors in the camera frame through pixels `places` (N, 2)."""
    flat = np.asarray(camera.cam_from_img(places)).reshape(-1, 2)
    rays = np.column_stack([flat, np.ones(len(flat))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def relative_pose(
    cameras: tuple[pycolmap.Camera, pycolmap.Camera],
    places: tuple[NDArray[np.float64], NDArray[np.float64]],
    matches: NDArray[np.uint32],
) -> TwoViews | None:
    """The relative pose of two images. `places` are their keypoints (N, 2), pixels. `matches` (M, 2) are pairs of
    keypoints. None if too few matches agree."""
    if len(matches) < _INLIERS:
        return None
    first, second = places[0][matches[:, 0]], places[1][matches[:, 1]]
    one, other = rays_of(cameras[0], first), rays_of(cameras[1], second)
    longest = max(cameras[0].width, cameras[0].height)
    pixel = longest / 640 / cameras[0].mean_focal_length()
    rotation = rotation_between(one, other, _ROTATED * pixel)
    turned = np.linalg.norm(other - one @ rotation.T, axis=1) < _ROTATED * pixel
    found = pycolmap.estimate_calibrated_two_view_geometry(
        cameras[0], places[0], cameras[1], places[1], matches, _options(longest)
    )
    pose = found.cam2_from_cam1 if found.config == _CALIBRATED else None
    inliers = np.zeros((0, 2), np.uint32) if pose is None else np.asarray(found.inlier_matches)
    if pose is not None and turned.sum() < _ALONE * len(inliers):
        return TwoViews(np.asarray(pose.rotation.matrix()), inliers, False, found)
    if turned.sum() < _INLIERS:
        return None
    # Keep the matches of both: near points move against far ones, which determines the size of the room.
    agreed = np.unique(np.concatenate([matches[turned], inliers]), axis=0)
    geometry = pycolmap.TwoViewGeometry()
    geometry.config, geometry.inlier_matches = _CALIBRATED, agreed
    # A unit vector replaces the unknown translation. Global mapping uses rotations and tracks only.
    geometry.cam2_from_cam1 = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), np.array([0, 0, 1.0]))
    return TwoViews(rotation, agreed, True, geometry)


def share_of_agreeing_matches(
    pose: pycolmap.Rigid3d,
    cameras: tuple[pycolmap.Camera, pycolmap.Camera],
    places: tuple[NDArray[np.float64], NDArray[np.float64]],
    matches: NDArray[np.uint32],
    nearest: float,
) -> float:
    """The share of the `matches` (M, 2) of two images that agree with a relative pose, second from first camera.

    A match agrees if its rays meet in a point that is farther than `nearest`, in the unit of the pose, or if they are
    parallel. `places` are the keypoints of the images (N, 2), pixels."""
    pixel = max(cameras[0].width, cameras[0].height) / 640 / cameras[0].mean_focal_length()
    one = rays_of(cameras[0], places[0][matches[:, 0]]) @ pose.rotation.matrix().T
    other = rays_of(cameras[1], places[1][matches[:, 1]])
    parallel = np.linalg.norm(one - other, axis=1) < _ROTATED * pixel
    normal = np.cross(one, other)
    size = np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    # Rays that meet are in one plane with the line between the cameras. Their distances follow from the sine rule.
    skew = np.abs(normal @ pose.translation) / size
    depth = (np.cross(other, pose.translation) * normal).sum(axis=1) / size**2
    meet = (depth > nearest) & (skew < _EPIPOLAR * pixel * np.maximum(depth, 1e-12))
    return float(np.mean(parallel | meet))


def from_matches(matches: NDArray[np.uint32]) -> TwoViews:
    """Two images that share these matches (M, 2), without a relative pose."""
    geometry = pycolmap.TwoViewGeometry()
    geometry.config, geometry.inlier_matches = _CALIBRATED, matches
    return TwoViews(np.eye(3), matches, True, geometry)


def rotation_between(one: NDArray[np.float64], other: NDArray[np.float64], near: float) -> NDArray[np.float64]:
    """(3, 3) rotation that turns most of the unit vectors `one` (N, 3) onto `other` (N, 3), to within about `near`
    radians. It selects the best of many pairs of vectors, then refines with weighted least squares."""
    rng = np.random.default_rng(0)
    picked = rng.integers(0, len(one), (_HYPOTHESES, 2))
    frames = [_frames(rays[picked[:, 0]], rays[picked[:, 1]]) for rays in (one, other)]
    tried = frames[1] @ frames[0].transpose(0, 2, 1)
    # The distance of two unit vectors follows from their dot product.
    products = np.einsum("ni,nj->ijn", other, one).reshape(9, -1)
    off = np.sqrt(np.maximum(2 - 2 * tried.reshape(-1, 9) @ products, 0))
    rotation = tried[np.argmin(np.minimum(off, 2 * near).sum(axis=1))]
    for _ in range(_ROUNDS):
        off = np.linalg.norm(one @ rotation.T - other, axis=1)
        weight = 1 / (1 + (off / near) ** 2) ** 2
        u, _, vt = np.linalg.svd((other * weight[:, None]).T @ one)
        rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return np.asarray(rotation)


def _frames(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(H, 3, 3) axes as columns: along a + b, along a - b, and perpendicular to both."""
    x, y = a + b, a - b
    z = np.cross(x, y)
    axes = np.stack([x, y, z], axis=2)
    return np.asarray(axes / np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12))


def _options(longest_side: int) -> pycolmap.TwoViewGeometryOptions:
    """Options that prefer an essential matrix to a homography. The decomposition of a homography is ambiguous: it gave
    rotations that were 5 to 50 degrees off."""
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.max_error = _EPIPOLAR * longest_side / 640
    options.ransac.max_num_trials = 1000
    options.ransac.random_seed = 0
    options.min_num_inliers = _INLIERS
    options.min_E_F_inlier_ratio, options.max_H_inlier_ratio = 0.6, 0.98
    options.compute_relative_pose = True
    return options


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
