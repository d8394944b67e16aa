"""Camera poses of images that have none: features, matches, focal length, verification, global mapping, loops.

Structure from motion on the CPU with pycolmap. Points that are tracked through the video carry weak texture from frame
to frame; SIFT features find the same place again later.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.poses.features import NOTHING, Features, find_features
from nvsim.poses.firmness import observations_of, scale_deviations
from nvsim.poses.focal_length import estimate_focal_length
from nvsim.poses.image_pairs import neighbor_pairs, similar_pairs
from nvsim.poses.image_set import ImageSet
from nvsim.poses.loops import close_loops
from nvsim.poses.mapping import adjust_all, global_mapping, reliable_pairs, triangulated, without_bad_points
from nvsim.poses.match_database import (
    Keypoints,
    Pair,
    camera_of,
    keypoints_of,
    set_cameras,
    write_database,
    write_geometries,
)
from nvsim.poses.two_views import TwoViews, relative_pose

_FEATURES, _CONTRAST = 1500, 0.005  # of an image; the contrast of plain walls
_FOCAL_OFF = 0.02  # of the focal length: if the first mapping finds one farther off, pairs are verified with it again
_TOO_LOOSE = 0.03  # standard deviation of the scale at which a video falls into pieces
_ROUNDS = 2  # of closing loops
_FEWEST = {True: 15, False: 25}  # matches of neighbors, of other pairs
Told = Callable[[str, int, int], None]
"""Called with the step in hand, what is done of it and in all."""


@dataclass(frozen=True, eq=False)
class FoundPoses:
    """
    model      the reconstruction of the largest piece: cameras, poses and points, in an unknown unit
    pieces     numbers of images of all pieces, the largest first
    focal      pixels, of each camera
    residual   pixels, the mean distance between points and where the images show them
    loops      pairs of images far apart in time that were matched and agree
    left_out   names of images without a pose in the model
    """

    model: pycolmap.Reconstruction
    pieces: tuple[int, ...]
    focal: tuple[float, ...]
    residual: float
    loops: int
    left_out: tuple[str, ...]


def find_poses(images: ImageSet, folder: Path, told: Told = lambda step, done, total: None) -> FoundPoses:
    """The poses of `images`. Intermediate files go to `folder`. Raises InputError if the images have too little in
    common."""
    features = _features(images, told)
    keypoints = keypoints_of(images, features)
    path = folder / "database.db"
    write_database(path, images, keypoints)
    neighbors = neighbor_pairs(images.clips) if images.ordered else []
    similar = sorted(set(similar_pairs(features, images.ordered, images.clips)) - set(neighbors))
    matches = _matches(keypoints, neighbors, True, told) | _matches(keypoints, similar, False, told)
    cameras = _first_cameras(images, keypoints, matches, neighbors or similar)
    for number in range(2):
        found = _relative_poses(images, cameras, keypoints, matches, told)
        views = reliable_pairs(found, neighbors, similar, images.ordered)
        set_cameras(path, cameras)
        write_geometries(path, views)
        told("mapping", number, 2)
        models = global_mapping(path, images.folder, folder / "mapped")
        if not models:
            raise InputError(
                f"The images in {images.folder} have too little in common for poses; film more slowly, with more "
                "overlap, and keep furniture or other texture in view."
            )
        before, cameras = cameras, _cameras_of(models[0], cameras)
        off = max(abs(cameras[k].mean_focal_length() / before[k].mean_focal_length() - 1) for k in cameras)
        if off < _FOCAL_OFF:
            break
    model, loops, tested = models[0], 0, set[Pair]()
    for number in range(_ROUNDS):
        told("loops", number, _ROUNDS)
        added = close_loops(model, keypoints, images.ordered, tested)
        loops += len(added)
        if number and not added:
            break
        views = views | added
        write_geometries(path, views)
        model = triangulated(model, path, images.folder, folder / "triangulated")
        model = adjust_all(without_bad_points(adjust_all(without_bad_points(model, 8.0))))
    sizes = [model.num_reg_images(), *(m.num_reg_images() for m in models[1:])]
    if images.ordered:
        model, pieces = largest_firm_piece(model)
        sizes = sorted([*pieces, *sizes[1:]], reverse=True)
    registered = {model.images[i].name for i in model.reg_image_ids()}
    return FoundPoses(
        model,
        tuple(sizes),
        tuple(float(c.mean_focal_length()) for c in model.cameras.values()),
        float(model.compute_mean_reprojection_error()),
        loops,
        tuple(name for name in images.names if name not in registered),
    )


def largest_firm_piece(model: pycolmap.Reconstruction) -> tuple[pycolmap.Reconstruction, list[int]]:
    """The model without the frames, in order of time, that are held to its largest part so loosely that their scale may
    slip, and the sizes of all parts."""
    seen = observations_of(model)
    cuts = np.flatnonzero(scale_deviations(seen) > _TOO_LOOSE)
    parts = np.split(seen.numbers, cuts + 1)
    largest = max(parts, key=len)
    kept = set(largest.tolist())
    for frame in {model.images[i].frame_id for i in model.reg_image_ids() if i not in kept}:
        model.deregister_frame(frame)
    return model, sorted((len(p) for p in parts), reverse=True)


def _features(images: ImageSet, told: Told) -> list[Features]:
    found: list[Features] = []
    with ThreadPoolExecutor() as pool:
        for features in pool.map(lambda name: _features_of(images.folder / name), images.names):
            found.append(features)
            told("features", len(found), len(images.names))
    return found


def _features_of(path: Path) -> Features:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        return NOTHING
    found = find_features(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB)), _FEATURES, contrast=_CONTRAST)
    # SIFT lists a place once for each of its orientations.
    _, single = np.unique(np.round(found.places * 4).astype(np.int64), axis=0, return_index=True)
    single = np.sort(single)
    return Features(found.places[single], found.descriptors[single])


def _matches(keypoints: list[Keypoints], pairs: list[Pair], near: bool, told: Told) -> dict[Pair, NDArray[np.uint32]]:
    """The matches (M, 2) of each of the pairs that has enough of them."""
    found = {}
    with ThreadPoolExecutor() as pool:
        for pair, own in zip(pairs, pool.map(lambda p: keypoints[p[0]].matches(keypoints[p[1]], near), pairs)):
            told("matches", len(found), len(pairs))
            if len(own) >= _FEWEST[near]:
                found[pair] = own
    return found


def _relative_poses(
    images: ImageSet,
    cameras: dict[int, pycolmap.Camera],
    keypoints: list[Keypoints],
    matches: dict[Pair, NDArray[np.uint32]],
    told: Told,
) -> dict[Pair, TwoViews]:
    def relative(pair: Pair) -> TwoViews | None:
        i, j = pair
        pair_cameras = cameras[int(images.camera[i])], cameras[int(images.camera[j])]
        return relative_pose(pair_cameras, (keypoints[i].places, keypoints[j].places), matches[pair])

    found = {}
    with ThreadPoolExecutor() as pool:
        for number, (pair, views) in enumerate(zip(matches, pool.map(relative, matches))):
            told("relative poses", number, len(matches))
            if views is not None:
                found[pair] = views
    return found


def _first_cameras(
    images: ImageSet, keypoints: list[Keypoints], matches: dict[Pair, NDArray[np.uint32]], pairs: list[Pair]
) -> dict[int, pycolmap.Camera]:
    """Each camera with a first focal length."""
    cameras = {}
    for number, camera in enumerate(images.cameras):
        own = [p for p in pairs if p in matches and images.camera[p[0]] == images.camera[p[1]] == number]
        own = [p for p in own if p[1] - p[0] >= 2][:: max(1, len(own) // 400)]
        places = ((keypoints[i].places[matches[i, j][:, 0]], keypoints[j].places[matches[i, j][:, 1]]) for i, j in own)
        focal = estimate_focal_length(places, camera.width, camera.height, camera.focal)
        cameras[number] = camera_of(camera, number + 1, focal)
    return cameras


def _cameras_of(model: pycolmap.Reconstruction, known: dict[int, pycolmap.Camera]) -> dict[int, pycolmap.Camera]:
    return known | {number - 1: camera for number, camera in model.cameras.items()}
