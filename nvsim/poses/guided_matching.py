"""Match photographs again when their poses are known roughly.

Photographs from places far apart share few features that are unmistakable in the whole image. With poses, a feature is
compared only with those near its epipolar line, among which it is unmistakable more often.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.geometry.rotation import rotation_angle
from nvsim.poses.features import match_descriptors, unit_vectors
from nvsim.poses.mapping import poses_of
from nvsim.poses.match_database import Keypoints, Pair
from nvsim.poses.threads import thread_pool
from nvsim.poses.two_views import TwoViews, relative_pose

_APART = 60.0  # degrees between the directions in which two images look, at most
_BASELINE = 0.03  # distance of two cameras over that to their points, at least; nearer ones match without help
_BAND = 6.0  # largest distance of a feature from its epipolar line in pixels, in an image of 640 pixels
_RATIO = 0.8  # distance to the best match over the distance to the second best
_FEATURES = 4000  # features of an image that are compared
_TURNED = 2.0  # degrees by which a verified pair may differ from the known poses


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
        if found is None or rotation_angle(found.rotation.T @ relative.rotation.matrix()) > _TURNED:
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
    return bool(between < _APART and _BASELINE < apart < 2)


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
