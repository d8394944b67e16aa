"""Close loops: match and verify pairs of images that a reconstruction places near each other.

A first reconstruction drifts by decimeters, because frames that are far apart in time share few tracks. It is still
accurate enough to predict which images overlap. A match is accepted only if its relative rotation agrees with the
reconstruction. This also rejects matches with an identical door elsewhere in the building.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.geometry.rotation import rotation_angle
from nvsim.poses.features import match_features
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
