"""Reconstructions by hand: cameras with known poses that see known points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT, FOCAL = 640, 480, 500.0


def camera(number: int = 1) -> pycolmap.Camera:
    return pycolmap.Camera.create_from_model_name(number, "SIMPLE_RADIAL", FOCAL, WIDTH, HEIGHT)


def pose(rotation: NDArray[np.float64], center: NDArray[np.float64]) -> pycolmap.Rigid3d:
    """Camera from world, by its (3, 3) rotation and the camera center (3,)."""
    return pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ center)


def facing(ahead: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) camera from world of a level camera that looks along `ahead`; world z is up."""
    z = ahead / np.linalg.norm(ahead)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def center_of(one: pycolmap.Rigid3d) -> NDArray[np.float64]:
    return np.asarray(-one.rotation.matrix().T @ one.translation)


def places_in(one: pycolmap.Rigid3d, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(N, 2) pixels of world points (N, 3), and which the image shows."""
    local = points @ one.rotation.matrix().T + one.translation
    ahead = local[:, 2] > 0.1
    places = FOCAL * local[:, :2] / np.where(ahead, local[:, 2], 1)[:, None] + (WIDTH / 2, HEIGHT / 2)
    shown = ahead & (places > 0).all(axis=1) & (places < (WIDTH, HEIGHT)).all(axis=1)
    return places, shown


def reconstruction(
    poses: Mapping[int, pycolmap.Rigid3d],
    points: NDArray[np.float64],
    shown_by: Mapping[int, Iterable[int]],
    places: Mapping[int, NDArray[np.float64]],
) -> pycolmap.Reconstruction:
    """Images at `poses` by number. `shown_by` lists the points (rows of `points`) of each image, in the order of its
    keypoints; `places` are the keypoints. Points of fewer than two images are not part of it."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera())
    seen: dict[int, list[tuple[int, int]]] = {}
    for number, one in poses.items():
        image = pycolmap.Image(name=f"{number:06d}.jpg", camera_id=1, image_id=number, keypoints=places[number])
        model.add_image_with_trivial_frame(image, one)
        for k, point in enumerate(shown_by[number]):
            seen.setdefault(int(point), []).append((number, k))
    for point, elements in seen.items():
        if len(elements) >= 2:
            track = pycolmap.Track()
            for number, k in elements:
                track.add_element(number, k)
            model.add_point3D(points[point], track)
    return model


def seen_from(
    poses: Mapping[int, pycolmap.Rigid3d], points: NDArray[np.float64], reach: float = np.inf
) -> tuple[dict[int, NDArray[np.intp]], dict[int, NDArray[np.float64]]]:
    """The points that each image shows, at most `reach` away, and their pixels."""
    shown_by, places = {}, {}
    for number, one in poses.items():
        found, shown = places_in(one, points)
        near = np.linalg.norm(points - center_of(one), axis=1) < reach
        shown_by[number] = np.flatnonzero(shown & near)
        places[number] = found[shown_by[number]]
    return shown_by, places


def turned(degrees: float, axis: tuple[float, float, float]) -> NDArray[np.float64]:
    """(3, 3)."""
    unit = np.array(axis) / np.linalg.norm(axis)
    return np.asarray(Rotation.from_rotvec(np.radians(degrees) * unit).as_matrix())


def angle_between(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Degrees between two rotations (3, 3)."""
    return float(np.degrees(Rotation.from_matrix(one.T @ other).magnitude()))
