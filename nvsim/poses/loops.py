"""Close loops: pairs of images that a reconstruction places near each other are matched and verified anew.

A first reconstruction drifts by decimeters, because frames that are far apart in time share few tracks. It is still
right enough to say which images show the same place, so a match is accepted only if its relative rotation is the one
of the reconstruction. That also refuses a second door of the same model elsewhere in the building.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pycolmap

from nvsim.poses.features import alike
from nvsim.poses.mapping import rotation_angle
from nvsim.poses.match_database import CALIBRATED, Keypoints, Pair, verification_options

_APART = 17  # frames of a video from which on two images are a loop
_NEAR, _TURNED = 0.6, 45.0  # times the median depth of points, and degrees between two images that are compared
_EACH = 8  # images that are compared with each
_AGREES = 4.0  # degrees between the relative rotations of match and reconstruction
_INLIERS = 18


def candidate_loops(model: pycolmap.Reconstruction, ordered: bool, tested: set[Pair]) -> list[Pair]:
    """Pairs of images, by index, that look at the same place according to the reconstruction; not those in `tested`."""
    numbers = np.array(sorted(model.reg_image_ids()))
    centers = np.array([model.images[n].projection_center() for n in numbers])
    axes = np.array([model.images[n].cam_from_world().rotation.matrix()[2] for n in numbers])
    depth = _median_depth(model)
    found: list[Pair] = []
    for k in range(len(numbers)):
        later = np.flatnonzero(numbers >= numbers[k] + (_APART if ordered else 1))
        distance = np.linalg.norm(centers[later] - centers[k], axis=1) / depth
        angle = np.degrees(np.arccos(np.clip(axes[later] @ axes[k], -1, 1)))
        fit = np.flatnonzero((distance < _NEAR) & (angle < _TURNED))
        for n in later[fit[np.argsort(distance[fit] + angle[fit] / 60, kind="stable")[:_EACH]]]:
            pair = int(numbers[k]) - 1, int(numbers[n]) - 1
            if pair not in tested:
                found.append(pair)
    return found


def close_loops(
    model: pycolmap.Reconstruction, path: Path, keypoints: Sequence[Keypoints], ordered: bool, tested: set[Pair]
) -> list[Pair]:
    """Writes the verified matches of candidate loops that agree with the reconstruction into the database at `path`;
    the pairs that were added. Pairs that were compared join `tested`."""
    candidates = candidate_loops(model, ordered, tested)
    tested.update(candidates)

    def verified(pair: Pair) -> pycolmap.TwoViewGeometry | None:
        one, other = (keypoints[i].features for i in pair)
        matches = alike(one, other).astype(np.uint32)
        if len(matches) < _INLIERS:
            return None
        first, second = (model.images[i + 1] for i in pair)
        cameras = [model.cameras[image.camera_id] for image in (first, second)]
        options = verification_options(max(cameras[0].width, cameras[0].height))
        found = pycolmap.estimate_calibrated_two_view_geometry(
            cameras[0], one.places, cameras[1], other.places, matches, options
        )
        if found.config != CALIBRATED or len(found.inlier_matches) < _INLIERS:
            return None
        relative = second.cam_from_world().rotation.matrix() @ first.cam_from_world().rotation.matrix().T
        off = rotation_angle(relative.T @ found.cam2_from_cam1.rotation.matrix())
        return found if off < _AGREES else None

    added = []
    with ThreadPoolExecutor() as pool, pycolmap.Database.open(path) as database:
        for pair, found in zip(candidates, pool.map(verified, candidates), strict=True):
            if found is None:
                continue
            i, j = pair[0] + 1, pair[1] + 1
            if database.exists_two_view_geometry(i, j):
                database.delete_two_view_geometry(i, j)
            database.write_two_view_geometry(i, j, found)
            added.append(pair)
    return added


def _median_depth(model: pycolmap.Reconstruction) -> float:
    """Units of the model from an image to a point that it shows."""
    points = list(model.points3D.values())[:: max(1, len(model.points3D) // 2000)]
    if not points:
        return 1.0
    firsts = [model.images[p.track.elements[0].image_id].projection_center() for p in points]
    return float(np.median(np.linalg.norm(np.array([p.xyz for p in points]) - np.array(firsts), axis=1)))
