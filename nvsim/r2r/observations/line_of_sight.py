"""Computes which viewpoints see each other from the depth strips, for R2R's `visible`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.decoding import decoded
from nvsim.files.regular import read_bytes
from nvsim.geometry.camera import look
from nvsim.geometry.skybox_faces import face_axes
from nvsim.graph.sight import FARTHEST_SEEN
from nvsim.graph.types import Viewpoint
from nvsim.r2r.observations.places import ScanPlaces
from nvsim.r2r.observations.skybox import UNITS_A_METRE

_NEAR = 0.25  # a surface occludes a viewpoint if it is at least this many meters in front of it


def visible_from(places: ScanPlaces, viewpoint: Viewpoint, others: Sequence[Viewpoint]) -> NDArray[np.bool_]:
    """Returns (N,) bool: which of `others` are visible from `viewpoint`, at most 16 m away.

    The depth strip of `viewpoint` must exist. Raises InputError if it is unreadable.
    """
    depth = read_depth(places, viewpoint.id)
    ways = np.array([o.position for o in others], np.float64).reshape(-1, 3) - viewpoint.position
    lengths = np.linalg.norm(ways, axis=1)
    rows, columns = strip_pixels(ways, depth.shape[0])
    seen = depth[rows, columns] / UNITS_A_METRE
    return np.asarray((lengths > 0) & (lengths < FARTHEST_SEEN) & ((seen == 0) | (seen > lengths - _NEAR)))


def strip_pixels(ways: NDArray[np.floating], side: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the rows and columns (...) in a strip for world directions (..., 3), for a pose that faces +y.

    `side` is the side of a face in pixels.
    """
    local = np.asarray(ways, np.float64) @ look(np.zeros(3), 0.0)[:3, :3]
    on_faces = np.einsum("...i,fij->...fj", local, face_axes())
    face = on_faces[..., 2].argmax(axis=-1)
    right, down, ahead = np.moveaxis(np.take_along_axis(on_faces, face[..., None, None], axis=-2)[..., 0, :], -1, 0)
    safe = np.maximum(ahead, 1e-12)
    row, column = (np.floor((1 + v / safe) / 2 * side).clip(0, side - 1).astype(np.int64) for v in (down, right))
    return row, face * side + column


def read_depth(places: ScanPlaces, viewpoint: str) -> NDArray[np.uint16]:
    """Reads the depth strip (S, 6 S) uint16 of a viewpoint. Raises InputError if it is unreadable."""
    import cv2

    path, again = places.depth(viewpoint), "export the scan again"
    image = decoded(read_bytes(path), path, cv2.IMREAD_UNCHANGED, what="a depth strip", then=again)
    if image.dtype != np.uint16 or image.ndim != 2 or image.shape[1] != 6 * image.shape[0]:
        raise InputError(f"{path} is not a depth strip of six square faces with 16 bits; {again}.")
    return np.asarray(image, np.uint16)
