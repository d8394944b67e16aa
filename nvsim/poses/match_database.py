"""Keypoints, matches and verified pairs of images in a COLMAP database, from which pycolmap maps.

Keypoints of an image are its SIFT features, then the points that were tracked through it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.poses.features import Features, alike
from nvsim.poses.image_set import ImageSet

Pair = tuple[int, int]
"""Indices of two images, the smaller first. A database counts images from 1."""

CALIBRATED = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
_FEWEST = {True: 15, False: 25}  # matches of neighbors, of other pairs
_PIXELS = 2.5  # from the epipolar line, in an image of 640 pixels
_INLIERS = 20


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Of one image: features, and the tracked points by increasing number.

    features  its SIFT features
    ids       (T,) int64, the numbers of its tracked points
    tracked   (T, 2) float64, their places, pixels
    """

    features: Features
    ids: NDArray[np.int64]
    tracked: NDArray[np.float64]

    @property
    def places(self) -> NDArray[np.float64]:
        """(N + T, 2) pixels."""
        return np.concatenate([self.features.places, self.tracked])

    def matches(self, other: Keypoints, tracked: bool) -> NDArray[np.uint32]:
        """(M, 2) keypoints of this and of the other image that are alike, or, if `tracked`, one tracked point."""
        found = alike(self.features, other.features)
        if tracked:
            _, mine, theirs = np.intersect1d(self.ids, other.ids, assume_unique=True, return_indices=True)
            found = np.concatenate([found, np.stack([mine + len(self.features), theirs + len(other.features)], axis=1)])
        return found.astype(np.uint32)


def keypoints_of(images: ImageSet, features: Sequence[Features], most: int = 350) -> list[Keypoints]:
    """The keypoints of all images. Of the tracked points, `most` per image are used: those that are tracked longest,
    spread over the image."""
    tracks = images.tracks
    used = _spread_tracks(images, most)
    found = []
    for i, own in enumerate(features):
        rows = np.flatnonzero(used & (tracks.frame == i))
        rows = rows[np.argsort(tracks.point[rows])]
        found.append(Keypoints(own, tracks.point[rows], tracks.places[rows]))
    return found


def _spread_tracks(images: ImageSet, most: int, columns: int = 8, rows: int = 6) -> NDArray[np.bool_]:
    """(N,) which lines of the tracks are used. A track of two images says nothing about scale and fills gaps only."""
    tracks = images.tracks
    count = np.bincount(tracks.point, minlength=tracks.points)
    sizes = np.array([(c.width, c.height) for c in images.cameras])[images.camera[tracks.frame]]
    x, y = np.clip((tracks.places / sizes * (columns, rows)).astype(int), 0, (columns - 1, rows - 1)).T
    cell = (tracks.frame * rows + y) * columns + x
    filled = np.zeros(len(images.names) * rows * columns, int)
    room = most / (rows * columns)
    by_point = np.argsort(tracks.point, kind="stable")
    ends = np.cumsum(count)
    used = np.zeros(len(tracks.point), bool)
    for point in np.argsort(-count, kind="stable"):
        if count[point] < 2:
            break
        lines = by_point[ends[point] - count[point] : ends[point]]
        free = filled[cell[lines]] < (room if count[point] > 2 else room / 2)
        if free.mean() > 0.5:
            filled[cell[lines]] += 1
            used[lines] = True
    return used


def write_database(path: Path, images: ImageSet, keypoints: Sequence[Keypoints]) -> None:
    """A new database with cameras, images and keypoints."""
    path.unlink(missing_ok=True)
    with pycolmap.Database.open(path) as database:
        rigs = {}
        for number, camera in enumerate(images.cameras, 1):
            model = pycolmap.Camera.create_from_model_name(
                number, "SIMPLE_RADIAL", camera.focal or 1.0, camera.width, camera.height
            )
            database.write_camera(model, use_camera_id=True)
            rig = pycolmap.Rig()
            rig.add_ref_sensor(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number))
            rigs[number] = database.write_rig(rig)
        for i, name in enumerate(images.names):
            camera_number = int(images.camera[i]) + 1
            database.write_image(pycolmap.Image(name=name, camera_id=camera_number, image_id=i + 1), use_image_id=True)
            frame = pycolmap.Frame()
            frame.frame_id, frame.rig_id = i + 1, rigs[camera_number]
            sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera_number)
            frame.add_data_id(pycolmap.data_t(sensor, i + 1))
            database.write_frame(frame, use_frame_id=True)
            database.write_keypoints(i + 1, keypoints[i].places.astype(np.float32))


def write_matches(path: Path, found: Iterable[tuple[Pair, NDArray[np.uint32]]], neighbors: bool) -> None:
    """The matches (M, 2) of pairs that have enough of them."""
    with pycolmap.Database.open(path) as database:
        for (i, j), matches in found:
            if len(matches) >= _FEWEST[neighbors]:
                database.write_matches(i + 1, j + 1, matches)


def read_matches(path: Path, pairs: Iterable[Pair]) -> Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """The matched places ((M, 2), (M, 2)), pixels, of each of the pairs that has matches."""
    with pycolmap.Database.open(path) as database:
        for i, j in pairs:
            if database.exists_matches(i + 1, j + 1):
                matches = database.read_matches(i + 1, j + 1)
                a, b = (database.read_keypoints(k + 1)[:, :2].astype(np.float64) for k in (i, j))
                yield a[matches[:, 0]], b[matches[:, 1]]


def set_cameras(path: Path, params: Mapping[int, Sequence[float]]) -> None:
    """The parameters (f, cx, cy, k) of cameras by index; relative poses of before are forgotten."""
    with pycolmap.Database.open(path) as database:
        for camera in database.read_all_cameras():
            camera.params = list(params[camera.camera_id - 1])
            camera.has_prior_focal_length = True
            database.update_camera(camera)
        database.clear_two_view_geometries()


def verification_options(longest_side: int) -> pycolmap.TwoViewGeometryOptions:
    """For images whose focal length is known. An essential matrix is believed before a fundamental one, which fits
    anything, and before a homography, whose decomposition is ambiguous: both gave turns that were 5 to 50 degrees
    off."""
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.max_error = _PIXELS * longest_side / 640
    options.ransac.max_num_trials = 2000
    options.ransac.random_seed = 0
    options.min_num_inliers = _INLIERS
    options.min_E_F_inlier_ratio, options.max_H_inlier_ratio = 0.6, 0.98
    options.compute_relative_pose = True
    return options


def verify(path: Path, longest_side: int) -> None:
    """Finds the relative pose of every matched pair."""
    pycolmap.geometric_verification(path, two_view_geometry_options=verification_options(longest_side))


def verified_pairs(path: Path) -> dict[Pair, pycolmap.TwoViewGeometry]:
    """The relative poses in the database."""
    with pycolmap.Database.open(path) as database:
        numbers, found = database.read_two_view_geometries()
    pairs = (pycolmap.pair_id_to_image_pair(number) for number in numbers)
    return {(int(i) - 1, int(j) - 1): geometry for (i, j), geometry in zip(pairs, found, strict=True)}


def forget(path: Path, pairs: Iterable[Pair]) -> None:
    """Deletes the relative poses of these pairs; their matches stay."""
    with pycolmap.Database.open(path) as database:
        for i, j in pairs:
            if database.exists_two_view_geometry(i + 1, j + 1):
                database.delete_two_view_geometry(i + 1, j + 1)
