"""Camera poses of panoramas that are cut into views. All views of a panorama share a center and have known rotations.

The features of all views of two panoramas are compared together, as rays over the whole sphere. The relative pose is
then far more certain than that of two ordinary images. No calibration is needed, and a rotation cannot be confused with
a translation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.rotation import rotation_angle
from nvsim.poses.features import Features, match_features
from nvsim.poses.from_images import FoundPoses, ProgressCallback, features_of_all
from nvsim.poses.image_pairs import image_descriptors
from nvsim.poses.image_set import ImageSet, RigOfViews
from nvsim.poses.mapping import (
    adjust_all,
    consistent_pairs,
    global_mapping,
    keep_images,
    without_bad_points,
)
from nvsim.poses.match_database import Pair, keypoints_of, known_camera, write_database, write_geometries
from nvsim.poses.piece_reliability import Observations, observations_of, scale_deviation
from nvsim.poses.straightening import level_and_scale
from nvsim.poses.threads import thread_pool
from nvsim.poses.two_views import TwoViews

_FEATURES, _FAR = 600, 400  # features of a view; features of a view that is compared with one far apart in time
_NEXT = (1, 2, 4)  # distances between the two panoramas of a pair of neighbors
_ALIKE, _APART = 6, 9  # similar panoramas that are compared with each panorama, and their least distance in time
_FIRST, _LOOK_ALIKE = 150, 12  # features of a view that are compared first, and least matches to continue
_PIXELS = 2.0  # largest error of a match, in a view of 480 pixels
_INLIERS, _SHARE = 25, 0.35  # matches that agree on one relative pose, at least: their number, and their share of all
_LOOP = 35  # least agreeing matches of panoramas far apart in time
_AROUND, _AGREES = 4, 3.0  # a loop is confirmed by another one within so many panoramas and degrees
_CERTAIN = 120  # agreeing matches with which a loop needs no confirmation
_HELD = 40  # points of a panorama, at least
_FIRM = 120  # shared points of the panoramas before and after a place with which it is firm for certain
_BEFORE, _NEARBY = 3, 20  # panoramas before and after a place: for these points, and for the standard deviation
_TOO_LOOSE = 0.025  # standard deviation of the log scale above which a video is split into pieces


@dataclass(frozen=True, eq=False)
class _Sphere:
    """The features of all views of a panorama.

    features  their positions are pixels of their views
    image     (M,) int64, index of the image of each feature
    row       (M,) int64, index of the feature in its image, the most distinct first
    """

    features: Features
    image: NDArray[np.int64]
    row: NDArray[np.int64]

    def match_with(self, other: _Sphere, most: int) -> NDArray[np.int64]:
        """(M, 2) matches with another panorama, among the `most` most distinct features of each view."""
        rows, theirs = np.flatnonzero(self.row < most), np.flatnonzero(other.row < most)
        found = match_features(self.features.select(rows), other.features.select(theirs))
        return np.stack([rows[found[:, 0]], theirs[found[:, 1]]], axis=1)


def find_rig_poses(
    images: ImageSet, folder: Path, report_progress: ProgressCallback = lambda step, done, total: None
) -> tuple[FoundPoses, tuple[int, ...]]:
    """Computes the poses of the views `images` of panoramas. Their `rig` and focal lengths must be given.

    Returns the poses and the number of panoramas of each piece, the largest first. Only the largest piece is kept.
    `left_out` has the first views of the other panoramas. Intermediate files are written to `folder`. Raises InputError
    if the panoramas have too little in common."""
    rig = images.rig
    assert rig is not None
    features = [f.most_distinct(_FEATURES) for f in features_of_all(images, report_progress)]
    spheres = _spheres(features, rig)
    first = np.unique(rig.frame, return_index=True)[1]  # first image of each panorama
    clips = images.clips[first]
    near = [(i, i + k) for i in range(len(spheres)) for k in _NEXT if i + k < len(spheres) and clips[i] == clips[i + k]]
    far = _similar(features, rig, clips)
    found = _relative_poses(images, spheres, [*near, *far], set(near), report_progress)
    views = consistent_pairs({pair: found[pair] for pair in near if pair in found})
    loops = select_reliable_loops({pair: found[pair] for pair in far if pair in found}, views)
    path = folder / "database.db"
    write_database(path, images, keypoints_of(images, features))
    write_geometries(path, _between_views(views | loops, spheres, images))
    report_progress("mapping", 0, 1)
    models = global_mapping(path, images.folder, folder / "mapped", known_rig=True)
    if not models:
        raise InputError(
            f"The panoramas in {images.folder} have too little in common for poses; walk more slowly, and keep "
            "furniture or other texture in view."
        )
    report_progress("loops", 0, 1)
    model = adjust_all(without_bad_points(models[0]), known_rig=True)
    _remove_bare(model, rig)
    seen = observations_of(model)
    frame = rig.frame[seen.numbers - 1]
    pieces = firmly_connected_panoramas(seen, frame) if images.ordered else [np.unique(frame)]
    keep_images(model, seen.numbers[np.isin(frame, pieces[0])].tolist())
    lost = np.setdiff1d(np.arange(len(spheres)), pieces[0])
    others = [len({int(rig.frame[i - 1]) for i in m.reg_image_ids()}) for m in models[1:]]
    sizes = (len(pieces[0]), *sorted([*(len(piece) for piece in pieces[1:]), *others], reverse=True))
    upright = (images.ordered and level_and_scale(model, images.folder),)
    posed = FoundPoses(
        (model,),
        tuple(float(c.mean_focal_length()) for c in model.cameras.values()),
        float(model.compute_mean_reprojection_error()),
        len(loops),
        tuple(images.names[i] for i in first[lost]),
        upright,
    )
    return posed, sizes


def _spheres(features: Sequence[Features], rig: RigOfViews) -> list[_Sphere]:
    found = []
    for frame in range(int(rig.frame.max(initial=-1)) + 1):
        own = np.flatnonzero(rig.frame == frame).tolist()
        rows = [np.arange(len(features[i])) for i in own]
        places = np.concatenate([features[i].places for i in own])
        descriptors = np.concatenate([features[i].descriptors for i in own])
        image = np.repeat(own, [len(r) for r in rows])
        found.append(_Sphere(Features(places, descriptors), image, np.concatenate(rows)))
    return found


def _similar(features: Sequence[Features], rig: RigOfViews, clips: NDArray[np.int64]) -> list[Pair]:
    """Pairs of panoramas, far apart in time, that look alike over all directions."""
    of_views = image_descriptors(features)
    words = np.zeros((len(clips), of_views.shape[1]))
    np.add.at(words, rig.frame, of_views)
    words /= np.maximum(np.linalg.norm(words, axis=1, keepdims=True), 1e-9)
    index, pairs = np.arange(len(words)), set()
    for i, row in enumerate(words @ words.T):
        near = (np.abs(index - i) < _APART) & (clips == clips[i])
        for j in np.argsort(-np.where(near, -np.inf, row), kind="stable")[:_ALIKE]:
            if not near[j]:
                pairs.add((min(i, int(j)), max(i, int(j))))
    return sorted(pairs)


def _relative_poses(
    images: ImageSet,
    spheres: Sequence[_Sphere],
    pairs: Sequence[Pair],
    near: set[Pair],
    report_progress: ProgressCallback,
) -> dict[Pair, TwoViews]:
    """Relative poses of the pairs of panoramas that overlap. Their matches are features of the two spheres."""
    rig = images.rig
    assert rig is not None
    turns = [pycolmap.Rigid3d(pycolmap.Rotation3d(turn), np.zeros(3)) for turn in rig.turns]
    cameras = [known_camera(camera, k + 1) for k, camera in enumerate(images.cameras)]
    options = pycolmap.RANSACOptions()
    options.max_error = _PIXELS * cameras[0].width / 480
    options.max_num_trials, options.random_seed = 1000, 0

    def relative(pair: Pair) -> TwoViews | None:
        one, other = (spheres[i] for i in pair)
        if pair not in near and len(one.match_with(other, _FIRST)) < _LOOK_ALIKE:
            return None
        matches = one.match_with(other, _FEATURES if pair in near else _FAR)
        if len(matches) < _INLIERS:
            return None
        a, b = matches.T
        found = pycolmap.estimate_generalized_relative_pose(
            one.features.places[a],
            other.features.places[b],
            images.camera[one.image[a]].tolist(),
            images.camera[other.image[b]].tolist(),
            turns,
            cameras,
            options,
        )
        pose = None if found is None else found.get("pano2_from_pano1")
        if found is None or pose is None:
            return None
        agreed = matches[np.asarray(found["inlier_mask"], bool)]
        if len(agreed) < max(_INLIERS if pair in near else _LOOP, _SHARE * len(matches)):
            return None
        geometry = pycolmap.TwoViewGeometry()
        geometry.cam2_from_cam1 = pose
        return TwoViews(np.asarray(pose.rotation.matrix()), agreed.astype(np.uint32), False, geometry)

    found = {}
    with thread_pool() as pool:
        for number, (pair, views) in enumerate(zip(pairs, pool.map(relative, pairs), strict=True)):
            report_progress("matches", number, len(pairs))
            if views is not None:
                found[pair] = views
    return found


def select_reliable_loops(loops: Mapping[Pair, TwoViews], chain: Mapping[Pair, TwoViews]) -> dict[Pair, TwoViews]:
    """Selects reliable loops: those with very many matches, and those that a nearby loop confirms with its rotation."""
    steps = {i: views.rotation for (i, j), views in chain.items() if j == i + 1}

    def chained_rotation(start: int, end: int) -> NDArray[np.float64] | None:
        """Rotation from panorama `start` to panorama `end`, chained over the steps between them."""
        turn = np.eye(3)
        for k in range(min(start, end), max(start, end)):
            if k not in steps:
                return None
            turn = steps[k] @ turn
        return turn if start <= end else turn.T

    kept = {}
    for (i, j), views in loops.items():
        agreeing = False
        for (k, m), other in loops.items():
            if agreeing or (k, m) == (i, j) or abs(k - i) > _AROUND or abs(m - j) > _AROUND:
                continue
            before, after = chained_rotation(i, k), chained_rotation(m, j)
            if before is not None and after is not None:
                expected = after @ other.rotation @ before
                agreeing = rotation_angle(expected.T @ views.rotation) < _AGREES
        if agreeing or len(views.matches) >= _CERTAIN:
            kept[i, j] = views
    return kept


def _between_views(
    found: Mapping[Pair, TwoViews], spheres: Sequence[_Sphere], images: ImageSet
) -> dict[Pair, TwoViews]:
    """Converts relative poses of panoramas to those of their views, by image indices, each with its matches."""
    rig = images.rig
    assert rig is not None
    turns = [pycolmap.Rigid3d(pycolmap.Rotation3d(turn), np.zeros(3)) for turn in rig.turns]
    between = {}
    for (i, j), views in found.items():
        pose = views.geometry.cam2_from_cam1
        assert pose is not None
        a, b = views.matches.T
        ends = np.stack([spheres[i].image[a], spheres[j].image[b]], axis=1)
        rows = np.stack([spheres[i].row[a], spheres[j].row[b]], axis=1).astype(np.uint32)
        for one, other in np.unique(ends, axis=0):
            first, second = turns[int(images.camera[one])], turns[int(images.camera[other])]
            geometry = pycolmap.TwoViewGeometry()
            geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
            geometry.inlier_matches = rows[(ends == (one, other)).all(axis=1)]
            geometry.cam2_from_cam1 = relative = second * pose * first.inverse()
            rotation = np.asarray(relative.rotation.matrix())
            between[int(one), int(other)] = TwoViews(rotation, geometry.inlier_matches, False, geometry)
    return between


def _remove_bare(model: pycolmap.Reconstruction, rig: RigOfViews) -> None:
    """Removes the panoramas that show too few points."""
    shown = np.zeros(len(rig.frame), np.int64)
    for number in model.reg_image_ids():
        shown[number - 1] = model.images[number].num_points3D
    points = np.bincount(rig.frame, shown)
    keep_images(model, [number for number in model.reg_image_ids() if points[rig.frame[number - 1]] >= _HELD])


def firmly_connected_panoramas(seen: Observations, frame: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Numbers of the panoramas of each firmly connected part of a video, the largest part first. `frame` (I,) is the
    panorama of each image of `seen`.

    As in `firm_pieces`, the video is cut where the scale could change, and parts that are connected elsewhere are
    merged again. Only places with few common points are examined.
    """
    kept = np.unique(frame)
    cuts = []
    for k in range(1, len(kept)):
        before, after = (np.isin(frame, near) for near in (kept[max(0, k - _BEFORE) : k], kept[k : k + _BEFORE]))
        if _count_shared_points(seen, before, after) >= _FIRM:
            continue
        before, after = (np.isin(frame, near) for near in (kept[max(0, k - _NEARBY) : k], kept[k : k + _NEARBY]))
        if scale_deviation(seen, before, after) > _TOO_LOOSE:
            cuts.append(k)
    pieces: list[NDArray[np.int64]] = []
    for part in np.split(kept, cuts):
        held = [p for p in pieces if scale_deviation(seen, np.isin(frame, p), np.isin(frame, part)) < _TOO_LOOSE]
        pieces = [p for p in pieces if not any(p is one for one in held)]
        pieces.append(np.concatenate([*held, part]))
    return sorted((np.sort(piece) for piece in pieces), key=len, reverse=True)


def _count_shared_points(seen: Observations, one: NDArray[np.bool_], other: NDArray[np.bool_]) -> int:
    """How many points are visible both in the images `one` (I,) and in the images `other` (I,)."""
    return len(np.intersect1d(seen.point[one[seen.image]], seen.point[other[seen.image]]))
