"""Reconstruct from verified image pairs: global mapping, triangulation, and bundle adjustment (pycolmap)."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nvsim.geometry.rotation import rotation_angle
from nvsim.poses.match_database import Keypoints, Pair
from nvsim.poses.two_views import TwoViews, share_of_agreeing_matches

_CERTAIN = 30  # matches of frames that are not next to each other and whose rotation cannot be checked, at least
_DRIFT, _STEP = 1.5, 0.5  # degrees: allowed difference of a pair from the chained rotations, fixed and per frame
_NEAR, _FAR = 3, 8  # steps of a video between neighbors, and between images that are compared, at most
_CONTRADICTED = 3.0  # degrees between two rotations of an image that contradict each other
_BENT = 2.0  # degrees between two rotations of an image at a bend
_AGREEING = 0.7  # share of the matches across a place of a video that agree with the poses, at least; else it is bent
_NEARER = 0.3  # times the distance of the nearest points of an image: distance of other points, at least
_PARALLAX = 1.0  # degrees between two rays of a point, at least
_FEWEST_OF_VIEWS = 5  # matches of two views of panoramas, at least; they agree with those of all views
_CONVERGED = 1e-5  # relative decrease of the cost; at zero, adjustment takes twice as long and moves cameras by 0.006 %
_NEARLY = 1e-4  # the same, if another adjustment follows
_ASTRAY = 4.0  # pixels: points with a larger reprojection error are removed


def consistent_pairs(found: Mapping[Pair, TwoViews]) -> dict[Pair, TwoViews]:
    """Selects the relative poses of neighboring frames of a video that agree with the rotations between the frames.

    Pairs of frames that contradict the chained rotations of the frames between them are removed. In front of a row of
    equal windows, frames some steps apart match one window with the next."""
    step: dict[int, NDArray[np.float64]] = {i: views.rotation for (i, j), views in found.items() if j == i + 1}
    for (i, j), views in found.items():
        if j == i + 2 and i + 1 in step and i not in step:
            step[i] = step[i + 1].T @ views.rotation
        elif j == i + 2 and i in step and i + 1 not in step:
            step[i + 1] = views.rotation @ step[i].T
    kept = {}
    for (i, j), views in found.items():
        if j > i + 1:
            turn: NDArray[np.float64] | None = np.eye(3)
            for k in range(i, j):
                turn = None if turn is None or k not in step else step[k] @ turn
            if turn is not None and rotation_angle(turn.T @ views.rotation) > _DRIFT + _STEP * (j - i):
                continue
            if turn is None and len(views.matches) < _CERTAIN:
                continue
        kept[i, j] = views
    return kept


def contradicted_rotations(
    poses: Mapping[int, pycolmap.Rigid3d], found: Mapping[Pair, TwoViews]
) -> dict[int, NDArray[np.float64]]:
    """Rotations (3, 3), world to camera, of the images of a video whose rotation contradicts the relative poses `found`
    of images near them, by image number. `poses` are world to camera.

    Where a camera rotates in place, few points have a parallax, and mapping and adjustment leave images there with any
    rotation. The images that agree with most of their pairs keep their rotations. Those of the others follow from them,
    from image to image."""
    pairs: dict[int, list[tuple[int, int, NDArray[np.float64]]]] = {n: [] for n in poses}
    for (i, j), views in found.items():
        if j - i <= _NEAR and i + 1 in poses and j + 1 in poses:
            pairs[j + 1].append((i + 1, len(views.matches), views.rotation))
            pairs[i + 1].append((j + 1, len(views.matches), views.rotation.T))
    rotations = {n: pose.rotation.matrix() for n, pose in poses.items()}

    def is_near(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
        return rotation_angle(one @ other.T) < _CONTRADICTED

    sure: set[int] = set()
    for n, own in pairs.items():
        agreeing = sum(w for k, w, onward in own if is_near(onward @ rotations[k], rotations[n]))
        if agreeing >= 0.5 * sum(w for _, w, _ in own):
            sure.add(n)
    contradicted: dict[int, NDArray[np.float64]] = {}
    while True:
        support = {n: sum(w for k, w, _ in own if k in sure) for n, own in pairs.items() if n not in sure}
        if not support or not max(support.values()):
            return contradicted
        n = max(support, key=lambda n: support[n])
        known = [(w, onward @ rotations[k]) for k, w, onward in pairs[n] if k in sure]
        best = max((r for _, r in known), key=lambda r: sum(w for w, other in known if is_near(r, other)))
        near = [(w, other) for w, other in known if is_near(best, other)]
        rotation = Rotation.from_matrix([r for _, r in near]).mean([w for w, _ in near]).as_matrix()
        if not is_near(rotation, rotations[n]):
            contradicted[n] = rotation
        rotations[n] = rotation
        sure.add(n)


def find_bends(images: Iterable[int], found: Mapping[Pair, TwoViews], agreement: Callable[[Pair], float]) -> list[int]:
    """Numbers of the `images` of a video after which their poses are bent. `agreement` returns the share of the matches
    of a pair in `found` that agree with the poses.

    Where the points of two stretches disagree, adjustment bends the video at a weak place. Neighboring images still
    agree there. Images that are farther apart do not, so they decide if there are any. Of the places in a row that they
    span, the bend is the one with the least agreement."""
    numbers = sorted(images)
    known = set(numbers)
    agreeing, counted = np.zeros((2, len(numbers))), np.zeros((2, len(numbers)))  # neighbors, other pairs
    for (i, j), views in found.items():
        if j - i <= _FAR and i + 1 in known and j + 1 in known:
            between = slice(bisect_left(numbers, i + 1), bisect_left(numbers, j + 1))
            agreeing[int(j - i > _NEAR), between] += agreement((i, j)) * len(views.matches)
            counted[int(j - i > _NEAR), between] += len(views.matches)
    far = counted[1] > 0
    share = np.where(far, agreeing[1], agreeing[0]) / np.maximum(np.where(far, counted[1], counted[0]), 1)
    overall = agreeing.sum(axis=0) / np.maximum(counted.sum(axis=0), 1)
    bent = np.flatnonzero((share < _AGREEING) & (counted.sum(axis=0) > 0))
    runs = np.split(bent, np.flatnonzero(np.diff(bent) > 1) + 1) if len(bent) else []
    return [numbers[run[overall[run].argmin()]] for run in runs]


def agreement_with(
    model: pycolmap.Reconstruction, keypoints: Sequence[Keypoints], found: Mapping[Pair, TwoViews]
) -> Callable[[Pair], float]:
    """A function that returns the share of the matches of a pair of images in `found` that agree with their poses in
    the model, at distances that the first image shows."""
    nearest: dict[int, float] = {}

    def nearest_to(image: pycolmap.Image) -> float:
        if image.image_id not in nearest:
            points = [model.points3D[p.point3D_id].xyz for p in image.points2D if p.has_point3D()]
            away = np.linalg.norm(np.array(points).reshape(-1, 3) - image.projection_center(), axis=1)
            nearest[image.image_id] = float(np.quantile(away, 0.05)) if points else float("inf")
        return nearest[image.image_id]

    def agreement(pair: Pair) -> float:
        first, second = (model.images[k + 1] for k in pair)
        cameras = (model.cameras[first.camera_id], model.cameras[second.camera_id])
        places = (keypoints[pair[0]].places, keypoints[pair[1]].places)
        relative = second.cam_from_world() * first.cam_from_world().inverse()
        return share_of_agreeing_matches(relative, cameras, places, found[pair].matches, _NEARER * nearest_to(first))

    return agreement


def are_poses_near(one: Mapping[int, pycolmap.Rigid3d], other: Mapping[int, pycolmap.Rigid3d], distance: float) -> bool:
    """Whether each image of `other` has nearly the pose that it has in `one` (world to camera, by image number): the
    centers are at most `distance` apart, and the rotations differ by less than those at a bend."""
    return all(
        np.linalg.norm(center_of(one[n]) - center_of(pose)) <= distance
        and rotation_angle(one[n].rotation.matrix().T @ pose.rotation.matrix()) < _BENT
        for n, pose in other.items()
    )


def correct_rotations(model: pycolmap.Reconstruction, found: Mapping[Pair, TwoViews]) -> None:
    """Corrects, in place, the rotations that contradict the relative poses `found` of the images of a video."""
    for number, rotation in contradicted_rotations(poses_of(model), found).items():
        move_image(model, number, with_rotation(model.images[number].cam_from_world(), rotation))


def move_image(model: pycolmap.Reconstruction, number: int, pose: pycolmap.Rigid3d) -> None:
    """Gives an image another pose, world to camera, and removes its observations, in place."""
    for k in range(len(model.images[number].points2D)):
        if model.images[number].points2D[k].has_point3D():  # else removed together with its point
            model.delete_observation(number, k)
    model.frames[model.images[number].frame_id].rig_from_world = pose


def global_mapping(path: Path, images: Path, folder: Path, known_rig: bool = False) -> list[pycolmap.Reconstruction]:
    """Reconstructs each connected part of the database (GLOMAP; Pan et al. 2024), the largest first.

    `known_rig` says that the lenses and the poses of the cameras on their rig are exact."""
    folder.mkdir(parents=True, exist_ok=True)
    options = pycolmap.GlobalPipelineOptions()
    options.random_seed = 0
    options.mapper.global_positioning.use_gpu = False
    options.mapper.bundle_adjustment.ceres.use_gpu = False
    if known_rig:
        options.min_num_matches = _FEWEST_OF_VIEWS
        options.mapper.refine_sensor_from_rig = False
        options.mapper.rotation_averaging.refine_sensor_from_rig = False
        options.mapper.global_positioning.refine_sensor_from_rig = False
        _keep_rig(options.mapper.bundle_adjustment)
    found = pycolmap.global_mapping(path, images, folder, options).values()
    return sorted((adjust_all(model, known_rig=known_rig) for model in found), key=lambda m: -m.num_reg_images())


def poses_of(model: pycolmap.Reconstruction) -> dict[int, pycolmap.Rigid3d]:
    """Camera poses, world to camera, by image number."""
    return {number: model.images[number].cam_from_world() for number in model.reg_image_ids()}


def keep_images(model: pycolmap.Reconstruction, numbers: Iterable[int]) -> None:
    """Removes the images that are not in `numbers` from the model, in place."""
    kept = set(numbers)
    for frame in {model.images[i].frame_id for i in model.reg_image_ids() if i not in kept}:
        model.deregister_frame(frame)


def reconstruction_of(
    poses: Mapping[int, pycolmap.Rigid3d], cameras: Mapping[int, pycolmap.Camera], path: Path
) -> pycolmap.Reconstruction:
    """A reconstruction without points: these cameras, and the images of the database at `path` that have `poses`, world
    to camera by image number, with their keypoints."""
    fresh = pycolmap.Reconstruction()
    for camera in cameras.values():
        fresh.add_camera_with_trivial_rig(camera)
    with pycolmap.Database.open(path) as database:
        for old in database.read_all_images():
            if old.image_id in poses:
                places = database.read_keypoints(old.image_id)[:, :2].astype(np.float64)
                image = pycolmap.Image(name=old.name, camera_id=old.camera_id, image_id=old.image_id, keypoints=places)
                fresh.add_image_with_trivial_frame(image, poses[old.image_id])
    return fresh


def triangulate_with_poses(
    poses: Mapping[int, pycolmap.Rigid3d],
    cameras: Mapping[int, pycolmap.Camera],
    path: Path,
    folder: Path,
) -> pycolmap.Reconstruction:
    """A reconstruction with these cameras and poses (world to camera, by image number), and with points without colors,
    triangulated from all verified pairs of the database at `path`. An intermediate file is written to `folder`."""
    fresh = reconstruction_of(poses, cameras, path)
    folder.mkdir(parents=True, exist_ok=True)
    options = pycolmap.IncrementalPipelineOptions()
    options.triangulation.min_angle = options.mapper.filter_min_tri_angle = _PARALLAX
    options.ba_global_function_tolerance, options.extract_colors = _NEARLY, False
    return pycolmap.triangulate_points(fresh, path, folder, folder, True, options)


def adjust_all(
    model: pycolmap.Reconstruction,
    principal_points: bool = False,
    held: Mapping[int, pycolmap.Rigid3d] | None = None,
    deviation: float = 1.0,
    known_rig: bool = False,
    coarse: bool = False,
    scale: float = 1.0,
) -> pycolmap.Reconstruction:
    """Bundle adjustment of the model in place, with robust weights. Returns the model.

    It refines poses and points. It also refines focal lengths and distortion, unless they belong to a `known_rig`, and
    the principal points if `principal_points`. `held` has poses, world to camera by image number. If given, camera
    centers stay near theirs, with a standard `deviation` in the unit of the model. A `coarse` adjustment takes half the
    time and precedes another one. Observations with an error of `scale` pixels have half the weight."""
    options = pycolmap.BundleAdjustmentOptions()
    if known_rig:
        _keep_rig(options)
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = scale
    options.ceres.solver_options.max_num_iterations = 50
    options.ceres.solver_options.function_tolerance = _NEARLY if coarse else _CONVERGED
    options.ceres.use_gpu = False
    options.refine_principal_point = principal_points
    if held is None:
        pycolmap.bundle_adjustment(model, options)
        return model
    config, priors = pycolmap.BundleAdjustmentConfig(), []
    for number in model.reg_image_ids():
        config.add_image(number)
        prior = pycolmap.PosePrior()
        prior.pose_prior_id = number
        prior.corr_data_id = model.images[number].data_id
        prior.position = center_of(held[number])
        prior.position_covariance = np.eye(3) * deviation**2
        prior.coordinate_system = pycolmap.PosePriorCoordinateSystem.CARTESIAN
        priors.append(prior)
    how = pycolmap.PosePriorBundleAdjustmentOptions()
    how.alignment_ransac.random_seed = 0
    pycolmap.create_pose_prior_bundle_adjuster(options, how, config, priors, model).solve()
    return model


def center_of(pose: pycolmap.Rigid3d) -> NDArray[np.float64]:
    """Camera center (3,) of a pose, world to camera."""
    return np.asarray(-pose.rotation.matrix().T @ pose.translation)


def with_rotation(pose: pycolmap.Rigid3d, rotation: NDArray[np.float64]) -> pycolmap.Rigid3d:
    """The pose, world to camera, with another rotation (3, 3) about the camera center."""
    return pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ center_of(pose))


def _keep_rig(options: pycolmap.BundleAdjustmentOptions) -> None:
    options.refine_focal_length = options.refine_extra_params = options.refine_sensor_from_rig = False


def without_bad_points(model: pycolmap.Reconstruction, astray: float = _ASTRAY) -> pycolmap.Reconstruction:
    """Removes points with a mean reprojection error of `astray` pixels or more, in place. Returns the model."""
    model.update_point_3d_errors()
    for number, point in list(model.points3D.items()):
        if point.track.length() < 2 or not point.error < astray:
            model.delete_point3D(number)
    return model
