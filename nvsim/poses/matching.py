"""Select pairs of images to compare by their poses, and match their features."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.poses.features import Features, match_features

_FARTHEST, _TURNED = 1.5, 35.0  # largest distance in meters and largest angle in degrees between compared cameras
_BASELINES = ((0.0, 0.12, 2), (0.12, 0.35, 3), (0.35, 0.8, 3), (0.8, _FARTHEST, 1))
"""Baselines from and to, meters, and how many frames at such a distance each frame is compared with. Near frames
determine the rotation, far frames the position."""
_A_METRE = 20.0  # degrees that count as much as a meter
_ASTRAY = 8.0  # pixels: largest distance of a match from its epipolar line by the given poses
_OFF = 1.5  # pixels: largest distance from the epipolar line of the fundamental matrix on which most matches agree
_LEAST = 10  # matches of a pair, at least


def pairs_to_compare(poses: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pairs of frames that likely overlap, the smaller index first. `poses` (N, 4, 4) are camera to world, meters."""
    from scipy.spatial import cKDTree

    places, views = poses[:, :3, 3], poses[:, :3, 2]
    tree = cKDTree(places)
    pairs: set[tuple[int, int]] = set()
    for i in range(len(places)):
        # Query the frames one by one: thousands of frames of one room have millions of neighbors in total.
        near = np.array(tree.query_ball_point(places[i], _FARTHEST, return_sorted=True), np.int64)
        others = near[near != i]
        metres = np.linalg.norm(places[others] - places[i], axis=1)
        turned = np.degrees(np.arccos(np.clip(views[others] @ views[i], -1, 1)))
        for low, high, count in _BASELINES:
            fit = np.flatnonzero((metres >= low) & (metres < high) & (turned < _TURNED))
            worse = turned[fit] + _A_METRE * np.abs(metres[fit] - (low + high) / 2)
            for j in others[fit[np.argsort(worse, kind="stable")[:count]]]:
                pairs.add((min(i, int(j)), max(i, int(j))))
    return sorted(pairs)


def match_cameras(one: Features, other: Features, first: Camera, second: Camera) -> NDArray[np.int64]:
    """(M, 2) int64, matched features of the images of the `first` and the `second` camera.

    Matches have similar descriptors, are near each other's epipolar lines, and agree with one fundamental matrix. Empty
    if there are fewer than 10."""
    none = np.zeros((0, 2), np.int64)
    pairs = match_features(one, other)
    a, b = one.places[pairs[:, 0]], other.places[pairs[:, 1]]
    near = np.abs(epipolar_distances(a, b, first, second)) < _ASTRAY
    pairs, a, b = pairs[near], a[near], b[near]
    if len(pairs) < _LEAST:
        return none
    _, agree = cv2.findFundamentalMat(a, b, cv2.FM_RANSAC, _OFF, 0.995, 500)
    if agree is None:
        return none
    pairs = pairs[agree.ravel() > 0]
    return pairs if len(pairs) >= _LEAST else none


def epipolar_distances(
    a: NDArray[np.float64], b: NDArray[np.float64], first: Camera, second: Camera
) -> NDArray[np.float64]:
    """Signed Sampson distances (N,) in pixels (Hartley and Zisserman, Multiple View Geometry, eq. 11.9).

    `a` (N, 2) are pixels of the `first` camera, and `b` (N, 2) the matched pixels of the `second`. Zero means that both
    can show one point."""
    relative = second.world_to_camera @ first.camera_to_world
    x, y, z = relative[:3, 3]
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ relative[:3, :3]
    fundamental = _inverse(second).T @ essential @ _inverse(first)
    ones = np.ones((len(a), 1))
    a, b = np.hstack([a, ones]), np.hstack([b, ones])
    on_second, on_first = a @ fundamental.T, b @ fundamental
    slopes = (on_second[:, :2] ** 2).sum(axis=1) + (on_first[:, :2] ** 2).sum(axis=1)
    return np.asarray((b * on_second).sum(axis=1) / np.sqrt(np.maximum(slopes, 1e-24)))


def _inverse(camera: Camera) -> NDArray[np.float64]:
    """(3, 3) matrix from pixels to directions."""
    k = camera.intrinsics
    return np.array([[1 / k.fx, 0, -k.cx / k.fx], [0, 1 / k.fy, -k.cy / k.fy], [0, 0, 1]])
