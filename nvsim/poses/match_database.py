"""Write keypoints, matches, and verified image pairs to a COLMAP database, the input of pycolmap.

The keypoints of an image are its features, followed by the points that were tracked through it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.poses.features import Features, match_features
from nvsim.poses.image_set import ImageSet, UnknownCamera
from nvsim.poses.two_views import TwoViews

Pair = tuple[int, int]
"""Indices of two images, the smaller first. Image numbers in a database start at 1."""

_TRACKED, _CELLS = 350, (8, 6)  # tracked points of an image, about, and its columns and rows over which they spread

pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)


@dataclass(frozen=True, eq=False)
class Keypoints:
    """The keypoints of an image: features, then tracked points by increasing number.

    features  features of the image
    ids       (T,) int64, numbers of its tracked points
    tracked   (T, 2) float64, their positions, pixels
    """

    features: Features
    ids: NDArray[np.int64]
    tracked: NDArray[np.float64]

    @property
    def places(self) -> NDArray[np.float64]:
        """(N + T, 2) float64, positions of all keypoints, pixels."""
        return np.concatenate([self.features.places, self.tracked])

    def matches(self, other: Keypoints, tracked: bool) -> NDArray[np.uint32]:
        """(M, 2) uint32, pairs of keypoints of this image and the other one that match.

        Features match by their descriptors. If `tracked`, tracked points match by their numbers too. Both are needed:
        the error of a tracked point grows from frame to frame, and features alone are too few on a plain wall."""
        found = match_features(self.features, other.features)
        if tracked:
            _, mine, theirs = np.intersect1d(self.ids, other.ids, assume_unique=True, return_indices=True)
            found = np.concatenate([found, np.stack([mine + len(self.features), theirs + len(other.features)], axis=1)])
        return found.astype(np.uint32)


def keypoints_of(images: ImageSet, features: Sequence[Features]) -> list[Keypoints]:
    """The keypoints of all images. At most about 350 tracked points are used per image: the longest tracks, spread
    over the image."""
    tracks = images.tracks
    used = _spread_tracks(images)
    found = []
    for i, own in enumerate(features):
        rows = np.flatnonzero(used & (tracks.frame == i))
        rows = rows[np.argsort(tracks.point[rows])]
        found.append(Keypoints(own, tracks.point[rows], tracks.places[rows]))
    return found


def _spread_tracks(images: ImageSet) -> NDArray[np.bool_]:
    """(N,) bool, which observations of the tracks are used. A track of two images does not determine a scale and only
    fills gaps."""
    columns, rows = _CELLS
    tracks = images.tracks
    count = np.bincount(tracks.point, minlength=tracks.points)
    sizes = np.array([(c.width, c.height) for c in images.cameras])[images.camera[tracks.frame]]
    x, y = np.clip((tracks.places / sizes * (columns, rows)).astype(int), 0, (columns - 1, rows - 1)).T
    cell = (tracks.frame * rows + y) * columns + x
    filled = np.zeros(len(images.names) * rows * columns, int)
    room = _TRACKED / (rows * columns)
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


def camera_of(camera: UnknownCamera, number: int, focal: float) -> pycolmap.Camera:
    """A camera without distortion whose principal point is the center of the image. `focal` is in pixels."""
    return pycolmap.Camera.create_from_model_name(number, "SIMPLE_RADIAL", focal, camera.width, camera.height)


def known_camera(camera: UnknownCamera, number: int) -> pycolmap.Camera:
    """A pinhole camera with known focal length. Raises ValueError if the focal length is unknown."""
    if camera.focal is None:
        raise ValueError("The camera of a rig has no focal length.")
    found = pycolmap.Camera.create_from_model_name(number, "PINHOLE", camera.focal, camera.width, camera.height)
    found.has_prior_focal_length = True
    return found


def write_database(path: Path, images: ImageSet, keypoints: Sequence[Keypoints]) -> None:
    """Writes a new database with cameras, rigs, images, and keypoints."""
    path.unlink(missing_ok=True)
    with pycolmap.Database.open(path) as database:
        for number, camera in enumerate(images.cameras, 1):
            one = camera_of(camera, number, 1.0) if images.rig is None else known_camera(camera, number)
            database.write_camera(one, use_camera_id=True)
        rigs = _write_rigs(database, images)
        frames: dict[int, pycolmap.Frame] = {}
        for i, name in enumerate(images.names):
            camera_number = int(images.camera[i]) + 1
            database.write_image(pycolmap.Image(name=name, camera_id=camera_number, image_id=i + 1), use_image_id=True)
            frame = frames.setdefault(i if images.rig is None else int(images.rig.frame[i]), pycolmap.Frame())
            frame.rig_id = rigs[camera_number]
            frame.add_data_id(pycolmap.data_t(_sensor(camera_number), i + 1))
            database.write_keypoints(i + 1, keypoints[i].places.astype(np.float32))
        for index, frame in frames.items():
            frame.frame_id = index + 1
            database.write_frame(frame, use_frame_id=True)


def _write_rigs(database: pycolmap.Database, images: ImageSet) -> dict[int, int]:
    """Writes a rig for each camera, or one rig for all cameras. Returns rig numbers by camera number."""
    numbers = range(1, len(images.cameras) + 1)
    found = {}
    if images.rig is None:
        for number in numbers:
            rig = pycolmap.Rig()
            rig.add_ref_sensor(_sensor(number))
            found[number] = database.write_rig(rig)
        return found
    rig = pycolmap.Rig()
    rig.add_ref_sensor(_sensor(1))
    for number, turn in zip(numbers[1:], images.rig.turns[1:]):
        rig.add_sensor(_sensor(number), pycolmap.Rigid3d(pycolmap.Rotation3d(turn), np.zeros(3)))
    return dict.fromkeys(numbers, database.write_rig(rig))


def _sensor(camera_number: int) -> pycolmap.sensor_t:
    return pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera_number)


def write_geometries(path: Path, found: Mapping[Pair, TwoViews]) -> None:
    """Replaces the relative poses in the database by `found`."""
    with pycolmap.Database.open(path) as database:
        database.clear_two_view_geometries()
        for (i, j), views in found.items():
            database.write_two_view_geometry(i + 1, j + 1, views.geometry)


def set_cameras(path: Path, cameras: Mapping[int, pycolmap.Camera]) -> None:
    """Writes the parameters of `cameras`, by index, to the database."""
    with pycolmap.Database.open(path) as database:
        for camera in database.read_all_cameras():
            camera.params = cameras[camera.camera_id - 1].params.tolist()
            camera.has_prior_focal_length = True
            database.update_camera(camera)
