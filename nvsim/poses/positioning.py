"""Reconstruct a video from relative poses: rotations, then camera centers and points in one convex problem.

Once the rotations are known, each observation fixes the direction from a camera center to a point. Centers and points
follow from these directions by least unsquared deviations (Ozyesil and Singer, Robust camera location estimation by
convex programming, 2015): the distances of points from their rays are minimal, and each point is at least one unit in
front of each camera that shows it. Because the problem is convex, the solution needs no initial values. Bundle
adjustment then refines rotations and lenses too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, coo_matrix, identity
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from nvsim.poses.mapping import adjust_all, poses_of, reconstruction_of, without_bad_points
from nvsim.poses.match_database import Keypoints, Pair
from nvsim.poses.two_views import TwoViews, rays_of

_FEWEST = 3  # images of a track, at least
_DOUBLE = 10.0  # pixels between two keypoints of one image in one track, which then mixes several points
_TRACKS = 700  # longest tracks of each image that are used, about
_ANY = np.array([0, 0, 1.0])  # a translation; the average of rotations uses none
_ROUNDS = 15  # of reweighting; the change is below a thousandth after ten
_NEAR = 0.05  # distance of a point from its ray at which its weight is half, in the unit of the solution
_OFF = 0.05  # sine of the angle between ray and point above which an observation is removed
_LOOSE, _ASTRAY = 4.0, 8.0  # pixels: scale of the robust weights at first; error of points that are removed then


@dataclass(frozen=True, eq=False)
class _Observations:
    """N observations of P points: image and keypoint indices (N,), point (N,) from 0 to P - 1."""

    image: NDArray[np.int64]
    keypoint: NDArray[np.int64]
    point: NDArray[np.int64]

    def select(self, kept: NDArray[np.bool_]) -> _Observations:
        return _Observations(self.image[kept], self.keypoint[kept], np.unique(self.point[kept], return_inverse=True)[1])


def reconstruct_video(
    path: Path,
    cameras: Mapping[int, pycolmap.Camera],
    camera: NDArray[np.int64],
    keypoints: Sequence[Keypoints],
    views: Mapping[Pair, TwoViews],
) -> list[pycolmap.Reconstruction]:
    """Reconstructs each connected part of a video, the largest first. `path` is the database with its images and
    keypoints. `camera` (N,) is the index of each image into `cameras`. `views` are relative poses of image pairs."""
    ends = np.array(list(views), np.int64).reshape(-1, 2)
    links = coo_matrix((np.ones(len(ends)), ends.T), shape=(len(keypoints),) * 2)
    _, part = connected_components(links, directed=False)
    models = []
    for number in np.flatnonzero(np.bincount(part) >= _FEWEST):
        inside = {pair: own for pair, own in views.items() if part[pair[0]] == number}
        model = _reconstruct(path, cameras, camera, keypoints, inside)
        if model is not None:
            models.append(model)
    return sorted(models, key=lambda m: -m.num_reg_images())


def _reconstruct(
    path: Path,
    cameras: Mapping[int, pycolmap.Camera],
    camera: NDArray[np.int64],
    keypoints: Sequence[Keypoints],
    views: Mapping[Pair, TwoViews],
) -> pycolmap.Reconstruction | None:
    rotations = average_rotations(views)
    seen = _tracks(keypoints, views)
    if not len(seen.image):
        return None
    rays = np.zeros((len(seen.image), 3))
    for i in np.unique(seen.image):
        own = seen.image == i
        places = keypoints[i].places[seen.keypoint[own]]
        rays[own] = rays_of(cameras[int(camera[i])], places) @ rotations[i]
    images, image = np.unique(seen.image, return_inverse=True)
    centers, points = positions_from_rays(image, seen.point, rays)
    toward = points[seen.point] - centers[image]
    along = (toward * rays).sum(axis=1)
    off = np.linalg.norm(toward - along[:, None] * rays, axis=1) / np.linalg.norm(toward, axis=1)
    poses: dict[int, pycolmap.Rigid3d] = {
        int(i) + 1: pycolmap.Rigid3d(pycolmap.Rotation3d(rotations[i]), -rotations[i] @ center)
        for i, center in zip(images, centers)
    }
    model = reconstruction_of(poses, {c.camera_id: c for c in cameras.values()}, path)
    good = (along > 0) & (off < _OFF)
    order = np.flatnonzero(good)[np.argsort(seen.point[good], kind="stable")]
    for own in np.split(order, np.flatnonzero(np.diff(seen.point[order])) + 1):
        if len(own) >= _FEWEST:
            track = pycolmap.Track()
            for i, k in zip(seen.image[own].tolist(), seen.keypoint[own].tolist()):
                track.add_element(i + 1, k)
            model.add_point3D(points[seen.point[own[0]]], track, np.zeros(3, np.uint8))
    adjust_all(model, coarse=True, scale=_LOOSE)
    return adjust_all(without_bad_points(model, _ASTRAY), coarse=True)


def average_rotations(views: Mapping[Pair, TwoViews]) -> dict[int, NDArray[np.float64]]:
    """The rotations (3, 3), world to camera, of the images by index, that agree best with the relative poses `views`
    of connected images."""
    graph, model = pycolmap.PoseGraph(), pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", 1.0, 1, 1))
    for i in sorted({i for pair in views for i in pair}):
        model.add_image_with_trivial_frame(pycolmap.Image(name=str(i), camera_id=1, image_id=i + 1))
    for (i, j), own in views.items():
        edge = pycolmap.PoseGraphEdge()
        edge.cam2_from_cam1 = pycolmap.Rigid3d(pycolmap.Rotation3d(own.rotation), _ANY)
        edge.num_matches = len(own.matches)
        graph.add_edge(i + 1, j + 1, edge)
    options = pycolmap.RotationEstimatorOptions()
    options.random_seed = 0
    pycolmap.run_rotation_averaging(options, graph, model, [])
    return {n - 1: pose.rotation.matrix() for n, pose in poses_of(model).items()}


def positions_from_rays(
    image: NDArray[np.int64], point: NDArray[np.int64], rays: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Camera centers (I, 3) and points (P, 3) from N observations, in any unit and with any origin.

    Observation n shows `point[n]` (0 to P - 1) in `image[n]` (0 to I - 1) in the direction `rays[n]`, a unit vector in
    world axes. The method is least unsquared deviations, by iteratively reweighted least squares."""
    along_ray = rays[:, :, None] * rays[:, None, :]
    across_ray = np.eye(3) - along_ray
    too_near, weight = np.ones(len(rays)), np.ones(len(rays))
    for _ in range(_ROUNDS):
        form = weight[:, None, None] * (across_ray + too_near[:, None, None] * along_ray)
        centers, points = _minimum(image, point, form, (weight * too_near)[:, None] * rays)
        toward = points[point] - centers[image]
        along = (toward * rays).sum(axis=1)
        too_near = (along < 1).astype(float)
        weight = 1 / (1 + np.linalg.norm(toward - along[:, None] * rays, axis=1) / _NEAR)
    return centers, points


def _minimum(
    image: NDArray[np.int64], point: NDArray[np.int64], form: NDArray[np.float64], target: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centers (I, 3) and points (P, 3) that minimize the sum over all observations of d A d - 2 b d, where d is the
    point minus the center, A is `form` (N, 3, 3), and b is `target` (N, 3). The points are eliminated first."""
    images, points = int(image.max()) + 1, int(point.max()) + 1
    of_image, of_point = np.zeros((images, 3, 3)), np.zeros((points, 3, 3))
    np.add.at(of_image, image, form)
    np.add.at(of_point, point, form)
    of_point += 1e-10 * np.trace(of_point, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    inverse = np.linalg.inv(of_point)
    pulls, shifts = np.zeros((points, 3)), np.zeros((images, 3))
    np.add.at(pulls, point, target)
    np.add.at(shifts, image, -target)
    order = np.lexsort((point, image))
    rows = np.concatenate([[0], np.cumsum(np.bincount(image, minlength=images))])
    mixed = bsr_matrix((form[order], point[order], rows), shape=(3 * images, 3 * points))
    eliminated = mixed @ bsr_matrix((inverse, np.arange(points), np.arange(points + 1)))
    system = bsr_matrix((of_image, np.arange(images), np.arange(images + 1))) - eliminated @ mixed.T
    system = system + 1e-11 * system.diagonal().mean() * identity(3 * images)  # fixes the origin
    centers = splu(system.tocsc()).solve(shifts.ravel() + eliminated @ pulls.ravel())
    placed = inverse @ (pulls + (mixed.T @ centers).reshape(-1, 3))[:, :, None]
    return centers.reshape(-1, 3), placed[:, :, 0]


def _tracks(keypoints: Sequence[Keypoints], views: Mapping[Pair, TwoViews]) -> _Observations:
    """The longest tracks: keypoints of three images or more that match, directly or through other images."""
    start = np.concatenate([[0], np.cumsum([len(k.places) for k in keypoints])])
    ends = np.concatenate([own.matches.astype(np.int64) + (start[i], start[j]) for (i, j), own in views.items()])
    links = coo_matrix((np.ones(len(ends), bool), ends.T), shape=(start[-1],) * 2)
    _, point = connected_components(links, directed=False)
    node = np.unique(ends)
    image = np.searchsorted(start, node, "right") - 1
    found = _Observations(image, node - start[image], point[node])
    # Of several keypoints of one image in a track, the first is used. Far ones show that the track mixes points.
    key = found.point * len(keypoints) + image
    _, first, same = np.unique(key, return_index=True, return_inverse=True)
    places = np.concatenate([k.places for k in keypoints])[node]
    apart = np.linalg.norm(places - places[first[same]], axis=1)
    is_first = np.zeros(len(node), bool)
    is_first[first] = True
    found = found.select(is_first & ~np.isin(found.point, found.point[apart > _DOUBLE]))
    length = np.bincount(found.point)
    found = found.select(length[found.point] >= _FEWEST)
    return _longest(found, len(keypoints)) if len(found.image) else found


def _longest(found: _Observations, images: int) -> _Observations:
    """The longest tracks, until each image has about as many as are used."""
    length = np.bincount(found.point)
    by_point = np.argsort(found.point, kind="stable")
    ends = np.cumsum(length)
    count, used = np.zeros(images, np.int64), np.zeros(len(length), bool)
    for k in np.argsort(-length, kind="stable"):
        own = found.image[by_point[ends[k] - length[k] : ends[k]]]
        if (count[own] < _TRACKS).any():
            used[k] = True
            count[own] += 1
    return found.select(used[found.point])
