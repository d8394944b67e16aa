"""Match pairs of images again that a reconstruction predicts to overlap: loops of a video, and photographs.

A first reconstruction drifts by decimeters, because frames that are far apart in time share few tracks. It is still
accurate enough to predict which images overlap. A match is accepted only if its relative rotation agrees with the
reconstruction. This also rejects matches with an identical door elsewhere in the building.

Photographs from places far apart share few features that are unmistakable in the whole image. With poses, a feature is
compared only with those near its epipolar line, among which it is unmistakable more often.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.geometry.rotation import rotation_angle
from nvsim.poses.features import match_descriptors, match_features, unit_vectors
from nvsim.poses.mapping import poses_of
from nvsim.poses.match_database import Keypoints, Pair
from nvsim.poses.pose_graph import PART, median_depth
from nvsim.poses.threads import thread_pool
from nvsim.poses.two_views import TwoViews, relative_pose

_APART = 17  # frames of a video between two images of a loop, at least
_NEAR, _TURNED = 0.6, 45.0  # largest distance of compared images in median depths, and their largest angle in degrees
_EACH = 8  # images that are compared with each image
_FIRST = 500  # features of an image that are compared first
_LOOK_ALIKE, _MATCHES = 12, 30  # least matches among these, and among all: loops that agree have 19 and 36 or more
_PLENTY = 6  # loops between the same two parts of a video; more take time and tell nothing new
_AT_ONCE = 64  # pairs that are compared before their loops are counted
_AGREES = 4.0  # largest angle between the relative rotations of match and reconstruction, degrees


def candidate_loops(model: pycolmap.Reconstruction, tested: set[Pair]) -> list[Pair]:
    """Pairs of images, by index, whose fields of view overlap in the reconstruction, except pairs in `tested`. The
    nearest pair of each image comes first, then the next, with images of one part far apart in the list."""
    numbers = np.array(sorted(model.reg_image_ids()))
    centers = np.array([model.images[n].projection_center() for n in numbers])
    axes = np.array([model.images[n].cam_from_world().rotation.matrix()[2] for n in numbers])
    depth = median_depth(model)
    found: list[tuple[int, int, Pair]] = []
    for k in range(len(numbers)):
        later = np.flatnonzero(numbers >= numbers[k] + _APART)
        distance = np.linalg.norm(centers[later] - centers[k], axis=1) / depth
        angle = np.degrees(np.arccos(np.clip(axes[later] @ axes[k], -1, 1)))
        fit = np.flatnonzero((distance < _NEAR) & (angle < _TURNED))
        nearest = later[fit[np.argsort(distance[fit] + angle[fit] / 60, kind="stable")[:_EACH]]]
        for rank, n in enumerate(nearest):
            pair = int(numbers[k]) - 1, int(numbers[n]) - 1
            if pair not in tested:
                found.append((rank, k % PART, pair))
    return [pair for _, _, pair in sorted(found)]


def close_loops(
    model: pycolmap.Reconstruction,
    keypoints: Sequence[Keypoints],
    similar: Sequence[Pair],
    tested: set[Pair],
    matches: dict[Pair, NDArray[np.uint32]],
    known: Mapping[Pair, TwoViews],
) -> dict[Pair, TwoViews]:
    """Relative poses that agree with the reconstruction, by pair of images, besides the `known` ones.

    The candidates are pairs that the reconstruction places near each other and the `similar` pairs. Between two parts
    of the video that have six loops, no more are searched. All compared pairs are added to `tested`, and their matches
    (M, 2) to `matches`, from which a later call takes them."""
    candidates = candidate_loops(model, tested)
    registered = set(model.reg_image_ids())
    listed = tested.union(candidates)
    candidates += [p for p in similar if p not in listed and p[0] + 1 in registered and p[1] + 1 in registered]

    def verify_pair(pair: Pair) -> TwoViews | None:
        one, other = (keypoints[i] for i in pair)
        if pair not in matches:
            seems = (
                len(match_features(one.features.most_distinct(_FIRST), other.features.most_distinct(_FIRST)))
                >= _LOOK_ALIKE
            )
            matches[pair] = one.matches(other, False) if seems else np.zeros((0, 2), np.uint32)
        if len(matches[pair]) < _MATCHES:
            return None
        first, second = (model.images[i + 1] for i in pair)
        pair_cameras = model.cameras[first.camera_id], model.cameras[second.camera_id]
        found = relative_pose(pair_cameras, (one.places, other.places), matches[pair])
        if found is None:
            return None
        relative = second.cam_from_world().rotation.matrix() @ first.cam_from_world().rotation.matrix().T
        return found if rotation_angle(relative.T @ found.rotation) < _AGREES else None

    count, found = Counter(_parts(pair) for pair in known), dict[Pair, TwoViews]()
    with thread_pool() as pool:
        for start in range(0, len(candidates), _AT_ONCE):
            pairs = [p for p in candidates[start : start + _AT_ONCE] if count[_parts(p)] < _PLENTY]
            tested.update(pairs)
            for pair, views in zip(pairs, pool.map(verify_pair, pairs), strict=True):
                if views is not None:
                    found[pair] = views
                    count[_parts(pair)] += 1
    return found


def _parts(pair: Pair) -> Pair:
    """The two parts of a video in which the images of `pair` are."""
    return pair[0] // PART, pair[1] // PART


_FACING = 60.0  # degrees between the directions in which two images look, at most
_BASELINE = 0.03  # distance of two cameras over that to their points, at least; nearer ones match without help
_BAND = 6.0  # largest distance of a feature from its epipolar line in pixels, in an image of 640 pixels
_RATIO = 0.8  # distance to the best match over the distance to the second best
_FEATURES = 4000  # features of an image that are compared
_OFF = 2.0  # degrees by which a verified pair may differ from the known poses


def guided_pairs(
    model: pycolmap.Reconstruction, keypoints: list[Keypoints], known: Mapping[Pair, TwoViews]
) -> dict[Pair, TwoViews]:
    """The relative poses of the pairs of images of `model` that match better than in `known`, and agree with it."""
    poses = poses_of(model)
    depth = _depths(model)
    pairs = [(i - 1, j - 1) for i in sorted(poses) for j in sorted(poses) if i < j and _overlap(poses, depth, i, j)]

    def match_pair(pair: Pair) -> TwoViews | None:
        i, j = pair
        cameras = tuple(model.cameras[model.images[k + 1].camera_id] for k in pair)
        relative = poses[j + 1] * poses[i + 1].inverse()
        matches = _matches((keypoints[i], keypoints[j]), (cameras[0], cameras[1]), relative)
        found = relative_pose((cameras[0], cameras[1]), (keypoints[i].places, keypoints[j].places), matches)
        if found is None or rotation_angle(found.rotation.T @ relative.rotation.matrix()) > _OFF:
            return None
        return found if pair not in known or len(found.matches) > len(known[pair].matches) else None

    with thread_pool() as pool:
        return {pair: views for pair, views in zip(pairs, pool.map(match_pair, pairs)) if views is not None}


def _depths(model: pycolmap.Reconstruction) -> dict[int, float]:
    """The median distance of the points of each image from its camera."""
    found = {}
    for number in model.reg_image_ids():
        image = model.images[number]
        points = np.array([model.points3D[p.point3D_id].xyz for p in image.points2D if p.has_point3D()]).reshape(-1, 3)
        away = np.linalg.norm(points - image.projection_center(), axis=1)
        found[number] = float(np.median(away)) if len(away) else float("inf")
    return found


def _overlap(poses: Mapping[int, pycolmap.Rigid3d], depth: Mapping[int, float], i: int, j: int) -> bool:
    """Whether two images may show the same things from places that differ."""
    rotation = poses[j].rotation.matrix() @ poses[i].rotation.matrix().T
    between = np.degrees(np.arccos(np.clip(rotation[2, 2], -1, 1)))
    apart = np.linalg.norm((poses[j] * poses[i].inverse()).translation) / min(depth[i], depth[j])
    return bool(between < _FACING and _BASELINE < apart < 2)


def _matches(
    keypoints: tuple[Keypoints, Keypoints], cameras: tuple[pycolmap.Camera, pycolmap.Camera], pose: pycolmap.Rigid3d
) -> NDArray[np.uint32]:
    """(M, 2) uint32 features of two images that are alike and near each other's epipolar lines. `pose` is the second
    camera from the first."""
    one, other = (k.features.most_distinct(_FEATURES) for k in keypoints)
    if not len(one) or not len(other):
        return np.zeros((0, 2), np.uint32)
    x, y = (_flat(camera, k.places) for camera, k in zip(cameras, (one, other)))
    a, b, c = pose.translation
    essential = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]]) @ pose.rotation.matrix()
    near = _BAND * max(cameras[1].width, cameras[1].height) / 640 / cameras[1].mean_focal_length()
    lines = x @ essential.T
    lines = (lines / np.maximum(np.linalg.norm(lines[:, :2], axis=1, keepdims=True), 1e-12)).astype(np.float32)
    places = np.ascontiguousarray(y.T.astype(np.float32))
    pairs = match_descriptors(
        unit_vectors(one), unit_vectors(other), _RATIO, lambda rows: np.abs(lines[rows] @ places) < near
    )
    return np.asarray(pairs, np.uint32)


def _flat(camera: pycolmap.Camera, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) pixels without distortion, in the image plane at the distance 1."""
    return np.column_stack([np.asarray(camera.cam_from_img(places)).reshape(-1, 2), np.ones(len(places))])
