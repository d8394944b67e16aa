"""One reconstruction from verified pairs of images: global mapping, triangulation, bundle adjustment (pycolmap)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pycolmap

from nvsim.poses.match_database import Pair
from nvsim.poses.two_views import TwoViews

_SUPPORT, _REACH = 2, 4  # pairs that must agree with a loop; frames before and after, among which they are looked for
_AGREES = 4.0  # degrees by which pairs that support each other may differ
_CERTAIN = 30  # matches of images that are three or more frames apart
_PARALLAX = 1.0  # degrees between two rays of a point
_ASTRAY = 4.0  # pixels: points seen farther off are removed


def rotation_angle(rotation: np.ndarray) -> float:
    """Degrees of a (3, 3) rotation."""
    return float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))


def reliable_pairs(
    found: Mapping[Pair, TwoViews], neighbors: Iterable[Pair], similar: Iterable[Pair], ordered: bool
) -> dict[Pair, TwoViews]:
    """The relative poses that can be trusted.

    In a video, images that look alike but are far apart in time may show two doors that are the same model. Such a
    pair stays only if two other pairs of frames near its ends have the same relative rotation.
    """
    if not ordered:
        return dict(found)
    near = {p: found[p] for p in neighbors if p in found and (p[1] - p[0] < 3 or len(found[p].matches) >= _CERTAIN)}
    loops = {p: found[p] for p in similar if p in found and len(found[p].matches) >= _CERTAIN and not found[p].turned}
    return near | {p: loops[p] for p in _supported(near, loops)}


def _supported(near: Mapping[Pair, TwoViews], loops: Mapping[Pair, TwoViews]) -> list[Pair]:
    turn: dict[Pair, np.ndarray] = {}
    for (i, j), views in (near | loops).items():
        turn[i, j], turn[j, i] = views.rotation, views.rotation.T
        turn[i, i] = turn[j, j] = np.eye(3)
    around = range(-_REACH, _REACH + 1)

    def support(i: int, j: int) -> int:
        others = ((i + a, j + b) for a in around for b in around if (a or b) and (i + a, j + b) in loops)
        return sum(
            (p, i) in turn
            and (j, q) in turn
            and rotation_angle(turn[p, q].T @ turn[j, q] @ turn[i, j] @ turn[p, i]) < _AGREES
            for p, q in others
        )

    return [pair for pair in loops if support(*pair) >= _SUPPORT]


def global_mapping(path: Path, images: Path, folder: Path, names: Sequence[str] = ()) -> list[pycolmap.Reconstruction]:
    """Reconstructions of the connected parts of the database, the largest first (GLOMAP; Pan et al. 2024); of `names`
    alone if any are given."""
    folder.mkdir(parents=True, exist_ok=True)
    options = pycolmap.GlobalPipelineOptions()
    options.random_seed = 0
    options.image_names = list(names)
    options.mapper.global_positioning.use_gpu = False
    options.mapper.bundle_adjustment.ceres.use_gpu = False
    found = pycolmap.global_mapping(path, images, folder, options).values()
    return sorted((adjust_all(model) for model in found), key=lambda m: -m.num_reg_images())


def triangulated(model: pycolmap.Reconstruction, path: Path, images: Path, folder: Path) -> pycolmap.Reconstruction:
    """A reconstruction with the cameras and poses of `model` and with points from all verified pairs."""
    fresh = pycolmap.Reconstruction()
    for camera in model.cameras.values():
        fresh.add_camera_with_trivial_rig(camera)
    with pycolmap.Database.open(path) as database:
        for number in model.reg_image_ids():
            old = model.images[number]
            places = database.read_keypoints(number)[:, :2].astype(np.float64)
            image = pycolmap.Image(name=old.name, camera_id=old.camera_id, image_id=number, keypoints=places)
            fresh.add_image_with_trivial_frame(image, old.cam_from_world())
    folder.mkdir(parents=True, exist_ok=True)
    options = pycolmap.IncrementalPipelineOptions()
    options.triangulation.min_angle = options.mapper.filter_min_tri_angle = _PARALLAX
    return pycolmap.triangulate_points(fresh, path, images, folder, True, options)


def adjust_all(model: pycolmap.Reconstruction, iterations: int = 50) -> pycolmap.Reconstruction:
    """Bundle adjustment of poses, points, focal lengths and distortion with robust weights, in place."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = 1.0
    options.ceres.solver_options.max_num_iterations = iterations
    options.ceres.use_gpu = False
    pycolmap.bundle_adjustment(model, options)
    return model


def without_bad_points(model: pycolmap.Reconstruction, astray: float = _ASTRAY) -> pycolmap.Reconstruction:
    """The model, in place, without points that lie more than `astray` pixels from where the images show them."""
    model.update_point_3d_errors()
    for number, point in list(model.points3D.items()):
        if point.track.length() < 2 or not point.error < astray:
            model.delete_point3D(number)
    return model
