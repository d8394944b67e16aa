"""How firmly the parts of a reconstruction hold together, and where they do not.

Before a bare wall, few points reach from the frames on one side to those on the other. Bundle adjustment then looks
perfect on both sides although one is larger than the other. The images alone tell how well each place of a video holds:
move everything after it by a similarity and count how much worse the images fit (the Fisher information of the seven
numbers of that similarity, with all points free).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pycolmap
from numpy.typing import NDArray

_DEGREES = 0.5  # of parallax that a point needs


@dataclass(frozen=True, eq=False)
class Observations:
    """A reconstruction as arrays: I images, P points, and N times that an image shows a point.

    numbers   (I,) int64, image numbers, increasing
    rotation  (I, 3, 3) float64, camera from world
    center    (I, 3) float64, camera centers, world
    focal     (I,) float64, pixels
    image     (N,) int64, index of the image
    point     (N,) int64, index of the point
    places    (P, 3) float64, points, world
    """

    numbers: NDArray[np.int64]
    rotation: NDArray[np.float64]
    center: NDArray[np.float64]
    focal: NDArray[np.float64]
    image: NDArray[np.int64]
    point: NDArray[np.int64]
    places: NDArray[np.float64]


def observations_of(model: pycolmap.Reconstruction) -> Observations:
    """The images and points of `model`."""
    numbers = np.array(sorted(model.reg_image_ids()), np.int64)
    index = {int(n): k for k, n in enumerate(numbers)}
    poses = [model.images[int(n)].cam_from_world() for n in numbers]
    focal = np.array([model.cameras[model.images[int(n)].camera_id].mean_focal_length() for n in numbers])
    image, point, places = [], [], []
    for k, p in enumerate(model.points3D.values()):
        places.append(p.xyz)
        for element in p.track.elements:
            image.append(index[element.image_id])
            point.append(k)
    return Observations(
        numbers,
        np.array([pose.rotation.matrix() for pose in poses]),
        np.array([model.images[int(n)].projection_center() for n in numbers]),
        focal,
        np.array(image, np.int64),
        np.array(point, np.int64),
        np.array(places).reshape(-1, 3),
    )


def scale_deviations(seen: Observations, pixel: float = 1.0) -> NDArray[np.float64]:
    """(I - 1,) standard deviation of the logarithm of the scale by which everything after each image could be larger,
    if features are off by `pixel`; infinite if nothing holds the two sides together."""
    found = np.full(len(seen.numbers) - 1, np.inf)
    away = seen.places[seen.point] - seen.center[seen.image]
    local = np.einsum("nij,nj->ni", seen.rotation[seen.image], away)
    ahead = local[:, 2] > 1e-6
    x, y, z = local.T
    f = seen.focal[seen.image]
    by_local = np.zeros((len(local), 2, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        by_local[:, 0, 0] = by_local[:, 1, 1] = f / z
        by_local[:, 0, 2], by_local[:, 1, 2] = -f * x / z**2, -f * y / z**2
    by_point = by_local @ seen.rotation[seen.image]  # (N, 2, 3) of pixels by the point, world
    by_point[~ahead] = 0
    first = np.full(len(seen.places), len(seen.numbers), np.int64)
    last = np.full(len(seen.places), -1, np.int64)
    np.minimum.at(first, seen.point, seen.image)
    np.maximum.at(last, seen.point, seen.image)
    normal = np.zeros((len(seen.places), 3, 3))
    np.add.at(normal, seen.point, np.einsum("nki,nkj->nij", by_point, by_point))
    inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    order = np.argsort(seen.point, kind="stable")
    ends = np.cumsum(np.bincount(seen.point, minlength=len(seen.places)))
    for cut in range(len(found)):
        straddling = np.flatnonzero((first <= cut) & (last > cut))
        if not len(straddling):
            continue
        lines = np.concatenate([order[ends[p - 1] if p else 0 : ends[p]] for p in straddling])
        later = seen.image[lines] > cut
        origin = seen.center[cut]
        # A later camera that moves by a similarity about `origin` sees a point as if the point moved by its inverse.
        offset = seen.places[seen.point[lines]] - origin
        moves = np.zeros((len(lines), 3, 7))
        moves[:, :, 0] = -offset
        moves[:, :, 1:4] = -np.eye(3)
        moves[:, 0, 5], moves[:, 0, 6] = -offset[:, 2], offset[:, 1]
        moves[:, 1, 4], moves[:, 1, 6] = offset[:, 2], -offset[:, 0]
        moves[:, 2, 4], moves[:, 2, 5] = -offset[:, 1], offset[:, 0]
        change = np.einsum("nki,nij->nkj", by_point[lines], moves) * later[:, None, None]
        information = np.einsum("nki,nkj->ij", change, change)
        mixed = np.zeros((len(seen.places), 3, 7))
        np.add.at(mixed, seen.point[lines], np.einsum("nki,nkj->nij", by_point[lines], change))
        mixed = mixed[straddling]
        information -= np.einsum("pia,pij,pjb->ab", mixed, inverse[straddling], mixed)
        values, vectors = np.linalg.eigh(information)
        if values[0] > 1e-9 * max(values[-1], 1e-12):
            found[cut] = pixel * np.sqrt(np.linalg.inv(information)[0, 0])
    return found
