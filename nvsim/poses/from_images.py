"""Camera poses of images that have none: features, matches, focal length, verification, global mapping, loops.

This is structure from motion on the CPU with pycolmap. Tracked points carry weak texture from frame to frame of a
video. Features match frames that show a place again later: those of SIFT, or of a network that measures better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.poses.feature_comparison import FeatureComparison, compare_features
from nvsim.poses.features import NOTHING, FeatureFinder, Features, find_features
from nvsim.poses.image_pairs import ALIKE, neighbor_pairs, similar_pairs
from nvsim.poses.image_set import ImageSet
from nvsim.poses.joining import PosePiece, join, piece_of
from nvsim.poses.mapping import (
    adjust_all,
    agreement_with,
    are_poses_near,
    consistent_pairs,
    contradicted_rotations,
    correct_rotations,
    find_bends,
    global_mapping,
    poses_of,
    triangulate_with_poses,
    with_rotation,
    without_bad_points,
)
from nvsim.poses.match_database import (
    Keypoints,
    Pair,
    camera_of,
    keypoints_of,
    set_cameras,
    write_database,
    write_geometries,
)
from nvsim.poses.piece_reliability import firmly_connected_pieces, uncertain_images
from nvsim.poses.pieces import (
    LEAST,
    names_in,
    split_after,
    split_into_pieces,
    split_off,
    submodel,
    with_images_beside,
    with_single_images,
)
from nvsim.poses.pose_graph import PartAnchors, keeps_shape, median_depth, without_drift
from nvsim.poses.positioning import reconstruct_video
from nvsim.poses.predicted_pairs import close_loops, guided_pairs
from nvsim.poses.straightening import (
    anchors_of,
    contradicts_floor,
    level_and_scale,
    merge_turning_pieces,
    rotated_images,
    straighten_video,
)
from nvsim.poses.threads import thread_pool
from nvsim.poses.two_views import TwoViews, estimate_focal_length, from_matches, relative_pose

_FEATURES, _CONTRAST = 1500, 0.005  # features of a frame of a video; SIFT contrast threshold for plain walls
_FEATURES_OF_PHOTOGRAPH = 8000  # at most: photographs from a few places differ much, so that few of many features match
_COMPARISONS = 3e10  # of features of all pairs of photographs, about: four minutes of one core
_FOCAL_OFF = 0.02  # relative change of the focal length in the first mapping above which pairs are verified again
_SAMPLE = 60  # frames of a video from which the focal length is first estimated
_ROUNDS, _MORE = 3, 1.1  # rounds of loop closure; loops over those of the last round, at least, for another round
_HELD = 0.05  # camera heights: standard deviation of a held camera
_ENOUGH = 0.85  # share of the images in the largest firm piece; below it, the floor is used
_LOOPS_LEFT = 0.5  # share of the loops that agree with a straightened video, at least
_MAPPINGS = 2  # with better focal lengths, at most
_JOINS, _STAYED = 2, 0.08  # joins over bends, at most; median depths that a piece which is in place moves, at most
_BESIDE = 0.2  # median depths between an image beside a piece and the end of the piece, at most
_LOOSE = 0.03  # standard deviation of the log scale above which a straightened video is split
_KEPT = 0.95  # share of the observed points that remain if a video is straightened again, at least
_CENTERED = 30  # images that are needed to estimate the principal point
_FEWEST = {True: 15, False: 25}  # matches of a pair, at least: of neighbors, of other pairs
ProgressCallback = Callable[[str, int, int], None]
"""Called with the name of the current step, the number of finished items, and their total."""
Placed = Callable[[Sequence[pycolmap.Reconstruction]], None]
"""Called with the current reconstructions, the largest first."""


@dataclass(frozen=True, eq=False)
class FoundPoses:
    """
    models     a reconstruction of each piece, the largest first: cameras, poses, and points, in an unknown unit
    focal      focal length of each camera, pixels
    residual   mean reprojection error, pixels
    loops      number of matched image pairs far apart in time that agree
    left_out   names of images without a pose in the largest piece
    upright    for each model, whether z is up and its unit is the height of the cameras above the floor
    compared   how SIFT and the features of a network compare, None if no network was given
    """

    models: tuple[pycolmap.Reconstruction, ...]
    focal: tuple[float, ...]
    residual: float
    loops: int
    left_out: tuple[str, ...]
    upright: tuple[bool, ...]
    compared: FeatureComparison | None = None

    @property
    def model(self) -> pycolmap.Reconstruction:
        """The reconstruction of the largest piece."""
        return self.models[0]

    @property
    def pieces(self) -> tuple[tuple[str, ...], ...]:
        """Names of the images of each piece."""
        return tuple(names_in(model) for model in self.models)


def find_poses(
    images: ImageSet,
    folder: Path,
    report_progress: ProgressCallback = lambda step, done, total: None,
    placed: Placed = lambda models: None,
    network: FeatureFinder | None = None,
) -> FoundPoses:
    """Computes the poses of `images`. Intermediate files are written to `folder`. `placed` receives the intermediate
    reconstructions. The features are those of SIFT, or those of a `network` if they measure better on a sample of
    pairs. Raises InputError if the images have too little in common."""
    features = features_of_all(images, report_progress)
    compared = None
    if network is not None:
        report_progress("comparison", 0, 1)
        compared = compare_features(images, features, network, lambda i: _features_of(images, i, network))
        if compared.is_network_used:
            features = features_of_all(images, report_progress, network)
    keypoints = keypoints_of(images, features)
    path = folder / "database.db"
    write_database(path, images, keypoints)
    similar = similar_pairs(features, images.ordered, images.clips)
    neighbors = neighbor_pairs(images.clips)
    first = neighbors if images.ordered else sorted({*similar, *neighbors})
    matches = _matches(keypoints, first, images.ordered, report_progress)
    cameras = _first_cameras(images, keypoints, matches)
    if images.ordered:
        cameras = _calibrate(images, cameras, keypoints, matches, path, folder, report_progress, placed)
    for number in range(_MAPPINGS):
        found = _relative_poses(images, cameras, keypoints, matches, report_progress)
        views = consistent_pairs(found) if images.ordered else found
        report_progress("mapping", number, _MAPPINGS)
        models = _map_images(images, cameras, keypoints, views, path, folder)
        if not models:
            raise InputError(
                f"The images in {images.folder} have too little in common for poses; film more slowly, with more "
                "overlap, and keep furniture or other texture in view."
            )
        placed(models)
        before, cameras = cameras, _cameras_of(models[0], cameras)
        off = max(abs(cameras[k].mean_focal_length() / before[k].mean_focal_length() - 1) for k in cameras)
        if off < _FOCAL_OFF:
            break
    inputs = _MappingInputs(images, keypoints, similar, views, path, folder, report_progress)
    return replace(_complete(models, inputs, placed), compared=compared)


@dataclass(frozen=True, eq=False)
class _MappingInputs:
    """Input of the steps after the first mapping: keypoints, pairs of similar images, relative poses `views` of pairs,
    `path` of the database, `folder` for files, and the progress callback. `matches` keeps those of possible loops."""

    images: ImageSet
    keypoints: list[Keypoints]
    similar: list[Pair]
    views: dict[Pair, TwoViews]
    path: Path
    folder: Path
    report_progress: ProgressCallback
    matches: dict[Pair, NDArray[np.uint32]] = field(default_factory=dict)


def _complete(models: list[pycolmap.Reconstruction], inputs: _MappingInputs, placed: Placed) -> FoundPoses:
    """Closes the loops of the first mapping of a video, adjusts, and splits the result into its firm pieces."""
    model, loops, held = models[0], list[Pair](), False
    images = inputs.images
    if images.ordered:
        for found in models:
            correct_rotations(found, inputs.views)
        model, views, loops = _close_loops(*_join_firm_pieces(None, models, inputs), inputs, False)
        model, joined, pieces = _joined_again(model, views, inputs)
        if len(joined) > len(views):  # the joined pieces are now near enough to show places of each other again
            model, _, loops = _close_loops(model, joined, inputs, False, loops)
            pieces = with_images_beside(model, pieces, _BESIDE * median_depth(model))
        pieces = split_off(pieces, rotated_images(model, images.folder, inputs.views, len(images.names)))
        bent = contradicts_floor(model, images.folder)
        if bent or len(pieces[0]) < _ENOUGH * len(images.names):
            placed([model])
            straight = _straight_videos(models, inputs)
            least = (0.5 if bent else 1) * len(pieces[0])
            # A straightened video that contradicts its loops took something else for the floor.
            if straight and len(straight[2][0]) > least and len(straight[1]) >= _LOOPS_LEFT * len(loops):
                (model, loops, pieces), held = straight, True
    else:
        model = _triangulate_and_adjust(poses_of(model), dict(model.cameras.items()), inputs, False)
        pieces = firmly_connected_pieces(model, images.times)
        if len(pieces) > 1:  # where the first matches suffice, those along epipolar lines are less exact
            inputs.report_progress("matches along epipolar lines", 0, 1)
            write_geometries(inputs.path, inputs.views | guided_pairs(model, inputs.keypoints, inputs.views))
            model = _triangulate_and_adjust(poses_of(model), dict(model.cameras.items()), inputs, False)
            pieces = firmly_connected_pieces(model, images.times)
    if images.ordered:
        astray = set(contradicted_rotations(poses_of(model), inputs.views))
        if not held:
            astray |= uncertain_images(model, images.times)
        pieces = [kept for piece in pieces if (kept := [n for n in piece if n not in astray])]
    separate = split_into_pieces(model, pieces, models, images.times)
    held, model = held and separate[0] is model, separate[0]
    if model.num_reg_images() >= _CENTERED:
        adjust_all(model, True, poses_of(model) if held else None, _HELD)
    without_bad_points(model)
    for piece in separate:
        piece.extract_colors_for_all_images(images.folder)
    upright = tuple(images.ordered and level_and_scale(piece, images.folder) for piece in separate)
    placed(separate)
    registered = set(names_in(model))
    return FoundPoses(
        tuple(separate),
        tuple(float(c.mean_focal_length()) for c in model.cameras.values()),
        float(model.compute_mean_reprojection_error()),
        len(loops),
        tuple(name for name in images.names if name not in registered),
        upright,
    )


def _straight_videos(
    models: list[pycolmap.Reconstruction], inputs: _MappingInputs
) -> tuple[pycolmap.Reconstruction, list[Pair], list[list[int]]] | None:
    """Straightens each video, and joins them by the points that they share. Returns what `_straight` returns."""
    clips = inputs.images.clips
    if not clips.any():
        return _straight(models, inputs)
    pieces: list[PosePiece] = []
    for clip in np.unique(clips):
        numbers = set((np.flatnonzero(clips == clip) + 1).tolist())
        parts = [submodel(model, own) for model in models if (own := numbers & set(model.reg_image_ids()))]
        straight = _straight(parts, inputs)
        if straight is not None:
            pieces += [piece_of(straight[0], p, inputs.keypoints) for p in straight[2] if len(p) >= LEAST]
    if not pieces:
        return None
    poses, views = _join_pieces(pieces, inputs)
    write_geometries(inputs.path, views)
    model = _triangulate_and_adjust(poses, dict(models[0].cameras.items()), inputs, True)
    model, _, loops = _close_loops(model, views, inputs, True)
    return model, loops, _pieces_of_straight(model, inputs)


def _straight(
    models: list[pycolmap.Reconstruction], inputs: _MappingInputs
) -> tuple[pycolmap.Reconstruction, list[Pair], list[list[int]]] | None:
    """Reconstructs a video with the help of its floor and walls. Returns the reconstruction, its loops, and its pieces;
    None if no floor is visible.

    Closed loops give it a shape in which the walls are measured better, so it is straightened again. If the images
    then show fewer of its points, or it breaks, the walls were not at right angles or not found."""
    poses = straighten_video(models, inputs.images.folder, inputs.images.times, inputs.views)
    if not poses:
        return None
    write_geometries(inputs.path, inputs.views)
    base = _triangulate_and_adjust(poses, dict(models[0].cameras.items()), inputs, True)
    model, _, loops = _close_loops(*_join_firm_pieces(base, models, inputs), inputs, True)
    pieces = _pieces_of_straight(model, inputs)
    poses = straighten_video([model], inputs.images.folder, inputs.images.times, inputs.views)
    if loops and len(poses) == model.num_reg_images():
        again = _triangulate_and_adjust(poses, dict(model.cameras.items()), inputs, True)
        if again.compute_num_observations() >= _KEPT * model.compute_num_observations():
            pieces_again = _pieces_of_straight(again, inputs)
            if len(pieces_again[0]) >= len(pieces[0]):
                model, pieces = again, pieces_again
    return model, loops, pieces


def _pieces_of_straight(model: pycolmap.Reconstruction, inputs: _MappingInputs) -> list[list[int]]:
    firm = firmly_connected_pieces(model, inputs.images.times, _LOOSE)
    return merge_turning_pieces(model, firm, inputs.images.folder, inputs.views)


def _close_loops(
    model: pycolmap.Reconstruction,
    views: dict[Pair, TwoViews],
    inputs: _MappingInputs,
    held: bool,
    known: Sequence[Pair] = (),
) -> tuple[pycolmap.Reconstruction, dict[Pair, TwoViews], list[Pair]]:
    """Closes loops. Returns the reconstruction, the image pairs that connect it, and its loops. If `held`, the floor
    and the walls hold its parts. `views` contains the loops that are already `known`."""

    def make_anchors(groups: list[list[int]]) -> PartAnchors:
        return anchors_of(model, groups, inputs.images.folder)

    seen_again, loops, tested = {pair: views[pair] for pair in known}, list(known), set(known)
    for number in range(_ROUNDS):
        inputs.report_progress("loops", number, _ROUNDS)
        seen_again |= close_loops(model, inputs.keypoints, inputs.similar, tested, inputs.matches, seen_again)
        loose = firmly_connected_pieces(model, inputs.images.times, _LOOSE) if held else []
        poses, agreeing = without_drift(model, seen_again, make_anchors if held else None, loose)
        # Beside known loops, a single new one can move a joined piece by decimeters.
        if len(agreeing) <= (_MORE if number else 1) * len(loops):
            break
        loops = agreeing
        write_geometries(inputs.path, views | {pair: seen_again[pair] for pair in loops})
        closed = _triangulate_and_adjust(poses, dict(model.cameras.items()), inputs, held)
        if not keeps_shape(model, closed):
            loops = list(known)
            break
        model = closed
    return model, views | {pair: seen_again[pair] for pair in loops}, loops


def _joined_again(
    model: pycolmap.Reconstruction, views: dict[Pair, TwoViews], inputs: _MappingInputs
) -> tuple[pycolmap.Reconstruction, dict[Pair, TwoViews], list[list[int]]]:
    """Joins the pieces between the bends of a video by points that they share. `views` connect its images. Returns the
    reconstruction with the largest piece, the views that connect it, and its pieces, the largest first.

    Adjustment leaves a bend where two stretches of a loop are decimeters apart, because the images then show few points
    of the other stretch. The points of both stretches together are still accurate enough to place one on the other. If
    a piece is already where these points place it, the relative poses at its bend are wrong, and there is no bend."""
    best: tuple[pycolmap.Reconstruction, dict[Pair, TwoViews], list[list[int]]] | None = None
    for number in range(_JOINS + 1):
        firm = with_single_images(firmly_connected_pieces(model, inputs.images.times))
        pieces = split_after(firm, _bends(model, inputs))
        if best is None or len(pieces[0]) > len(best[2][0]):
            best = model, views, pieces
        large = [piece_of(model, p, inputs.keypoints) for p in pieces if len(p) >= LEAST]
        poses, across = join(large, inputs.images.clips) if len(large) > 1 else ({}, {})
        joined = [piece for piece in pieces if piece[0] in poses]
        if len(joined) < 2:
            break
        if are_poses_near(poses_of(model), poses, _STAYED * median_depth(model)):
            apart = [piece for piece in pieces if piece[0] not in poses]
            return model, views, sorted([sorted(poses), *apart], key=len, reverse=True)
        if number < _JOINS:
            views = views | {pair: from_matches(own) for pair, own in across.items() if pair not in views}
            write_geometries(inputs.path, views)
            model = _triangulate_and_adjust(poses, dict(model.cameras.items()), inputs, False)
    assert best is not None
    return best


def _bends(model: pycolmap.Reconstruction, inputs: _MappingInputs) -> list[int]:
    return find_bends(model.reg_image_ids(), inputs.views, agreement_with(model, inputs.keypoints, inputs.views))


def _join_firm_pieces(
    base: pycolmap.Reconstruction | None, models: list[pycolmap.Reconstruction], inputs: _MappingInputs
) -> tuple[pycolmap.Reconstruction, dict[Pair, TwoViews]]:
    """Joins the firm pieces of a video. Returns the reconstruction and the image pairs that connect it.

    With a straightened `base`, the firm pieces of `models` that share no image with it are joined to it. Without it,
    the firm pieces of all `models` are joined."""
    times = inputs.images.times
    there = set() if base is None else set(base.reg_image_ids())
    pieces = [] if base is None else [piece_of(base, sorted(there), inputs.keypoints)]
    for model in models:
        if there.isdisjoint(model.reg_image_ids()):
            pieces += [
                piece_of(model, p, inputs.keypoints) for p in firmly_connected_pieces(model, times) if len(p) >= LEAST
            ]
    first = models[0] if base is None else base
    if len(pieces) < 2:
        return first, inputs.views
    poses, views = _join_pieces(pieces, inputs)
    if len(views) == len(inputs.views) and base is not None:
        return base, inputs.views
    write_geometries(inputs.path, views)
    return _triangulate_and_adjust(poses, dict(first.cameras.items()), inputs, base is not None), views


def _join_pieces(
    pieces: list[PosePiece], inputs: _MappingInputs
) -> tuple[dict[int, pycolmap.Rigid3d], dict[Pair, TwoViews]]:
    """Poses, world to camera by image number, of the pieces that match the largest one. Also the image pairs that
    connect them."""
    poses, across = join(pieces, inputs.images.clips)
    return poses, inputs.views | {pair: from_matches(own) for pair, own in across.items() if pair not in inputs.views}


def _triangulate_and_adjust(
    poses: Mapping[int, pycolmap.Rigid3d], cameras: Mapping[int, pycolmap.Camera], inputs: _MappingInputs, held: bool
) -> pycolmap.Reconstruction:
    """Triangulates and adjusts the images at `poses`, world to camera by image number. If `held`, their unit is the
    camera height and the adjustment holds the cameras near these poses."""
    if inputs.images.ordered:
        turned = contradicted_rotations(poses, inputs.views)
        poses = {**poses, **{n: with_rotation(poses[n], rotation) for n, rotation in turned.items()}}
    model = triangulate_with_poses(poses, cameras, inputs.path, inputs.folder / "triangulated")
    for astray in (8.0, 4.0):
        adjust_all(without_bad_points(model, astray), False, poses if held else None, _HELD, coarse=True)
    return model


def features_of_all(
    images: ImageSet, report_progress: ProgressCallback, network: FeatureFinder | None = None
) -> list[Features]:
    """The features of each image, of SIFT or of a `network`. They are empty for an image that cannot be read."""
    found: list[Features] = []
    with thread_pool() as pool:
        for features in pool.map(lambda i: _features_of(images, i, network), range(len(images.names))):
            found.append(features)
            report_progress("features", len(found), len(images.names))
    return found


def _features_of_photograph(count: int) -> int:
    """The number of features of each of `count` photographs: the more photographs, the fewer, to bound the time."""
    pairs = count * min(count - 1, 3 * ALIKE) / 2
    return int(np.clip((_COMPARISONS / max(pairs, 1)) ** 0.5, _FEATURES, _FEATURES_OF_PHOTOGRAPH))


def _features_of(images: ImageSet, index: int, network: FeatureFinder | None) -> Features:
    image = cv2.imread(str(images.folder / images.names[index]), cv2.IMREAD_COLOR)
    if image is None:
        return NOTHING
    rgb, usable = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8), images.usable_pixels(index)
    most = _FEATURES if images.ordered or images.rig else _features_of_photograph(len(images.names))
    if network is not None:
        return network.find(rgb, most, usable)
    found = find_features(rgb, most, usable, _CONTRAST)
    # SIFT lists a keypoint once for each of its orientations.
    _, single = np.unique(np.round(found.places * 4).astype(np.int64), axis=0, return_index=True)
    return found.select(np.sort(single))


def _matches(
    keypoints: list[Keypoints], pairs: list[Pair], near: bool, report_progress: ProgressCallback
) -> dict[Pair, NDArray[np.uint32]]:
    """The matches (M, 2) of each pair that has enough of them."""
    found: dict[Pair, NDArray[np.uint32]] = {}
    with thread_pool() as pool:
        for pair, own in zip(pairs, pool.map(lambda p: keypoints[p[0]].matches(keypoints[p[1]], near), pairs)):
            report_progress("matches", len(found), len(pairs))
            if len(own) >= _FEWEST[near]:
                found[pair] = own
    return found


def _relative_poses(
    images: ImageSet,
    cameras: dict[int, pycolmap.Camera],
    keypoints: list[Keypoints],
    matches: dict[Pair, NDArray[np.uint32]],
    report_progress: ProgressCallback,
) -> dict[Pair, TwoViews]:
    def relative(pair: Pair) -> TwoViews | None:
        i, j = pair
        pair_cameras = cameras[int(images.camera[i])], cameras[int(images.camera[j])]
        return relative_pose(pair_cameras, (keypoints[i].places, keypoints[j].places), matches[pair])

    found = {}
    with thread_pool() as pool:
        for number, (pair, views) in enumerate(zip(matches, pool.map(relative, matches))):
            report_progress("relative poses", number, len(matches))
            if views is not None:
                found[pair] = views
    return found


def _first_cameras(
    images: ImageSet, keypoints: list[Keypoints], matches: dict[Pair, NDArray[np.uint32]]
) -> dict[int, pycolmap.Camera]:
    """Each camera with an initial focal length."""
    cameras = {}
    for number, camera in enumerate(images.cameras):
        own = [p for p in matches if images.camera[p[0]] == images.camera[p[1]] == number]
        own = [p for p in own if p[1] - p[0] >= 2][:: max(1, len(own) // 400)]
        places = ((keypoints[i].places[matches[i, j][:, 0]], keypoints[j].places[matches[i, j][:, 1]]) for i, j in own)
        focal = estimate_focal_length(places, camera.width, camera.height, camera.focal)
        cameras[number] = camera_of(camera, number + 1, focal)
    return cameras


def _calibrate(
    images: ImageSet,
    cameras: dict[int, pycolmap.Camera],
    keypoints: list[Keypoints],
    matches: dict[Pair, NDArray[np.uint32]],
    path: Path,
    folder: Path,
    report_progress: ProgressCallback,
    placed: Placed,
) -> dict[int, pycolmap.Camera]:
    """The cameras, calibrated on the part of the video whose frames share most with later ones. The part is short, so
    an initial focal length that is some percent off costs little time."""
    count = len(images.names)
    if count < 2 * _SAMPLE or len(images.cameras) > 1:
        return cameras
    shared = np.zeros(count)
    for (i, j), own in matches.items():
        if 5 <= j - i <= 8:
            shared[i] += min(len(own), 200)
    start = int(np.convolve(shared, np.ones(_SAMPLE), "valid").argmax())
    inside = {p: own for p, own in matches.items() if start <= p[0] and p[1] < start + _SAMPLE}
    found = _relative_poses(images, cameras, keypoints, inside, report_progress)
    views = consistent_pairs(found)
    models = _map_images(images, cameras, keypoints, views, path, folder)
    if not models or models[0].num_reg_images() < _SAMPLE // 2:
        return cameras
    placed(models)
    return _cameras_of(models[0], cameras)


def _map_images(
    images: ImageSet,
    cameras: dict[int, pycolmap.Camera],
    keypoints: list[Keypoints],
    views: dict[Pair, TwoViews],
    path: Path,
    folder: Path,
) -> list[pycolmap.Reconstruction]:
    set_cameras(path, cameras)
    write_geometries(path, views)
    if images.ordered:
        return reconstruct_video(path, cameras, images.camera, keypoints, views)
    return global_mapping(path, images.folder, folder / "mapped")


def _cameras_of(model: pycolmap.Reconstruction, known: dict[int, pycolmap.Camera]) -> dict[int, pycolmap.Camera]:
    return known | {number - 1: camera for number, camera in model.cameras.items()}
