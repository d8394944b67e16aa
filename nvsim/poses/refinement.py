"""Refine given poses with the images, for hand-held captures and poses from odometry: select pairs of images by their
poses, match their features, and adjust all poses to the matches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.capture.masks import usable_pixels
from nvsim.capture.types import Frame
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.geometry.sampling import evenly_spaced
from nvsim.poses.adjustment import adjust
from nvsim.poses.features import MOST, NOTHING, Features, find_features, match_features
from nvsim.poses.threads import thread_pool
from nvsim.poses.tracks import tracks_of

_LONGEST_SIDE = 640  # pixels of the images that are compared
_SAMPLE = 40  # image pairs from which the quality of the given poses is measured
_APART = (0.15, 0.8)  # meters between the cameras of each pair
_FEW = 8  # with fewer measured pairs, the quality is unknown
_GOOD = 0.3  # pixels: poses with a smaller miss are good; exact poses miss by 0.1, those of an odometer by 0.6
_BETTER = 0.7  # refined error over the given error, at most; otherwise the given poses stay
_IN_ALL = 1_500_000  # features of all images, at most; a building of 6,000 m2 takes 1.5 GB with so many
_LEAST = 200  # features of each image, at least
ProgressCallback = Callable[[int, int], None]
"""Receives the finished and the total number of steps."""
_FARTHEST, _TURNED = 1.5, 35.0  # largest distance in meters and largest angle in degrees between compared cameras
_BASELINES = ((0.0, 0.12, 2), (0.12, 0.35, 3), (0.35, 0.8, 3), (0.8, _FARTHEST, 1))
"""Baselines from and to, meters, and how many frames at such a distance each frame is compared with. Near frames
determine the rotation, far frames the position."""
_A_METER = 20.0  # degrees that count as much as a meter
_ASTRAY = 8.0  # pixels: largest distance of a match from its epipolar line by the given poses
_OFF = 1.5  # pixels: largest distance from the epipolar line of the fundamental matrix on which most matches agree
_FEWEST_MATCHES = 10  # matches of a pair, at least


@dataclass(frozen=True, eq=False)
class RefinedPoses:
    """frames         the frames with their new poses
    before, after  median reprojection errors with the given and with the new poses, pixels
    meters         median distance by which cameras moved, meters; `degrees` is the median rotation
    """

    frames: tuple[Frame, ...]
    before: float
    after: float
    meters: float
    degrees: float


def median_epipolar_error(frames: Sequence[Frame]) -> float | None:
    """The median distance of matched features from their epipolar lines, pixels, over a sample of pairs of `frames`.
    None if too few images overlap."""
    poses = np.stack([f.camera_to_world for f in frames]) if frames else np.zeros((0, 4, 4))
    pairs = []
    for i, j in pairs_to_compare(poses):
        if _APART[0] <= np.linalg.norm(poses[i, :3, 3] - poses[j, :3, 3]) <= _APART[1]:
            pairs.append((i, j))
    chosen = [pairs[k] for k in evenly_spaced(len(pairs), _SAMPLE)]

    def measure_pair(pair: tuple[int, int]) -> float | None:
        (one, first), (other, second) = (_features_of_frame(frames[k]) for k in pair)
        found = match_cameras(one, other, first, second)
        if not len(found):
            return None
        off = epipolar_distances(one.places[found[:, 0]], other.places[found[:, 1]], first, second)
        return float(np.median(np.abs(off)))

    with thread_pool() as pool:
        distances = [off for off in pool.map(measure_pair, chosen) if off is not None]
    return float(np.median(distances)) if len(distances) >= _FEW else None


def are_poses_good(missed: float | None) -> bool:
    """Whether the poses need no refinement: `miss` is small, or unknown (None)."""
    return missed is None or missed < _GOOD


def refine(frames: Sequence[Frame], report_progress: ProgressCallback = lambda done, of: None) -> RefinedPoses | None:
    """Returns the frames with poses that agree with the images. None if the refinement improves too little, or if no
    point is visible in several images. Cameras stay within centimeters of their given positions. The orientation and
    the size of the whole capture do not change."""
    poses = np.stack([f.camera_to_world for f in frames]) if frames else np.zeros((0, 4, 4))
    pairs, done = pairs_to_compare(poses), 0
    seen: list[tuple[Features, Camera]] = []
    matches: list[NDArray[np.int64]] = []
    with thread_pool() as pool:
        most = max(_LEAST, min(MOST, _IN_ALL // max(1, len(frames))))
        for found in pool.map(partial(_features_of_frame, most=most), frames):
            seen.append(found)
            report_progress(done := done + 1, 2 * len(frames))

        def compared(pair: tuple[int, int]) -> NDArray[np.int64]:
            (one, first), (other, second) = (seen[k] for k in pair)
            return match_cameras(one, other, first, second)

        for number, agree in enumerate(pool.map(compared, pairs)):
            matches.append(agree)
            report_progress(len(frames) + number * len(frames) // max(1, len(pairs)), 2 * len(frames))
    tracks = tracks_of([features for features, _ in seen], pairs, matches)
    if not len(tracks.point):
        return None
    adjusted = adjust([camera for _, camera in seen], tracks)
    if not adjusted.after < _BETTER * adjusted.before:
        return None
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_matrix(poses[:, :3, :3].transpose(0, 2, 1) @ adjusted.poses[:, :3, :3]).magnitude()
    moved = np.linalg.norm(adjusted.poses[:, :3, 3] - poses[:, :3, 3], axis=1)
    better = tuple(replace(f, camera_to_world=pose) for f, pose in zip(frames, adjusted.poses, strict=True))
    medians = float(np.median(moved)), float(np.degrees(np.median(turned)))
    return RefinedPoses(better, adjusted.before, adjusted.after, *medians)


def _features_of_frame(frame: Frame, most: int = MOST) -> tuple[Features, Camera]:
    """The features of an image, and its camera. Empty for an image that cannot be read; other stages report it."""
    size = frame.intrinsics.limited_to(_LONGEST_SIDE)
    camera = Camera(size, frame.camera_to_world)
    try:
        return find_features(read_image(frame, size), most, usable_pixels(frame, size)), camera
    except InputError:
        return NOTHING, camera


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
        meters = np.linalg.norm(places[others] - places[i], axis=1)
        turned = np.degrees(np.arccos(np.clip(views[others] @ views[i], -1, 1)))
        for low, high, count in _BASELINES:
            fit = np.flatnonzero((meters >= low) & (meters < high) & (turned < _TURNED))
            worse = turned[fit] + _A_METER * np.abs(meters[fit] - (low + high) / 2)
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
    if len(pairs) < _FEWEST_MATCHES:
        return none
    _, agree = cv2.findFundamentalMat(a, b, cv2.FM_RANSAC, _OFF, 0.995, 500)
    if agree is None:
        return none
    pairs = pairs[agree.ravel() > 0]
    return pairs if len(pairs) >= _FEWEST_MATCHES else none


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
