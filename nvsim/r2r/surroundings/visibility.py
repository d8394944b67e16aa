"""Colors and distances that a viewpoint of an exported scan sees in all directions, and the floor around it from above.

Both are read from its strips.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.images import decode_pixels
from nvsim.files.opening import read_bytes
from nvsim.geometry.camera import camera_pose
from nvsim.geometry.directions import face_axes, face_rays
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.observations.skybox import UNITS_A_METER, read_depth, strip_pixels

PIXEL = 0.02
"""Size of a patch pixel in meters, about the width of joints between tiles and planks."""
_HALF = 1.6  # half side of a patch in meters; joints are not resolved at larger distances
_OFF, _SLANTED = 0.06, 0.02  # tolerance of the floor depth: meters, and meters per meter of the ray
SIDE = 128
"""Pixels of a face after downscaling."""
_REACH = 8.0  # meters; farther points are too coarse
Labeler = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]
"""Gives (S, S) numbers of objects, 0 for none, for a face (S, S, 3) uint8 RGB."""


@dataclass(frozen=True, eq=False)
class FloorPatch:
    """A square image of the floor.

    low     (x, y) meters of the lower corner of pixel [0, 0]; rows follow y, columns x
    colors (G, G, 3) uint8, RGB
    seen    (G, G) bool, whether the pixel shows the floor and not an object on it
    """

    low: tuple[float, float]
    colors: NDArray[np.uint8]
    seen: NDArray[np.bool_]


def floor_patch(viewpoint: Viewpoint, strip: NDArray[np.uint8], meters: NDArray[np.floating]) -> FloorPatch:
    """Returns the floor patch of a viewpoint with a level pose facing +y.

    strip   (S, 6 S, 3) uint8 RGB
    meters  (S, 6 S) distances in meters along the rays, 0 if there is no surface
    """
    along = (np.arange(round(2 * _HALF / PIXEL)) + 0.5) * PIXEL - _HALF
    x, y = np.meshgrid(along, along)
    ways = np.stack([x, y, np.full_like(x, -viewpoint.height)], axis=-1).reshape(-1, 3)
    rows, columns = strip_pixels(ways, strip.shape[0])
    lengths = np.linalg.norm(ways, axis=1)
    seen = np.abs(meters[rows, columns] - lengths) <= _OFF + _SLANTED * lengths
    low = float(viewpoint.position[0]) - _HALF, float(viewpoint.position[1]) - _HALF
    return FloorPatch(low, strip[rows, columns].reshape(*x.shape, 3), seen.reshape(x.shape))


@dataclass(frozen=True, eq=False)
class ViewFromViewpoint:
    """The view from a viewpoint.

    meters  (S, 6 S) float32 meters along the rays of a strip's pixels, 0 if there is no surface
    points  (n, 3) float32, meters, world, of the pixels within 8 m
    colors (n, 3) uint8, RGB
    underfoot  the floor around the viewpoint
    labels  (n,) uint8 numbers of objects, 0 for none, or None if no network names objects
    """

    viewpoint: Viewpoint
    meters: NDArray[np.float32]
    points: NDArray[np.float32]
    colors: NDArray[np.uint8]
    underfoot: FloorPatch
    labels: NDArray[np.uint8] | None = None

    @property
    def floor(self) -> float:
        """World z of the floor under the viewpoint."""
        return self.viewpoint.position[2] - self.viewpoint.height

    def visible_and_passed(self, points: NDArray[np.floating]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Returns (N,) whether points (N, 3), meters, world, are seen, and (N,) whether the viewpoint sees past them.

        A point is seen if a surface is at its distance in its direction.
        """
        ways = np.asarray(points, np.float64) - self.viewpoint.position
        lengths = np.linalg.norm(ways, axis=1)
        rows, columns = strip_pixels(ways, self.meters.shape[0])
        meters = self.meters[rows, columns]
        slack = 0.1 + 0.03 * lengths
        return np.abs(meters - lengths) <= slack, (meters == 0) | (meters > lengths + 2 * slack)


def has_depth(places: ScanPlaces, graph: NavGraph) -> bool:
    """Whether the strips and depth strips of all included viewpoints exist."""
    included = [v.id for v in graph.viewpoints.values() if v.included]
    return bool(included) and all(
        places.skyboxes.strip(id).is_file() and places.skyboxes.depth(id).is_file() for id in included
    )


def views_from_viewpoints(root: Path, graph: NavGraph, labeler: Labeler | None = None) -> Iterator[ViewFromViewpoint]:
    """Yields the view from each included viewpoint of the scan in the export folder `root`. `labeler` numbers objects
    in the four level faces.

    Poses must be level and face +y, as `nvsim export scan` writes them. Raises InputError if a strip is missing or
    damaged.
    """
    places = ScanPlaces(root, graph.scan)
    for viewpoint in graph.viewpoints.values():
        if viewpoint.included:
            yield _view_from(places, viewpoint, labeler)


def _view_from(places: ScanPlaces, viewpoint: Viewpoint, labeler: Labeler | None) -> ViewFromViewpoint:
    import cv2

    depth, path = read_depth(places, viewpoint.id), places.skyboxes.strip(viewpoint.id)
    strip = decode_pixels(
        read_bytes(path), path, cv2.IMREAD_COLOR, what="a skybox strip", then="export the scan again"
    )[..., ::-1]
    side = min(SIDE, depth.shape[0])
    if strip.shape[:2] != depth.shape:
        raise InputError(f"{path} does not have the size of its depth strip; export the scan again.")
    rows = (np.arange(side) * 2 + 1) * depth.shape[0] // (2 * side)
    columns = (np.arange(6 * side) * 2 + 1) * depth.shape[1] // (12 * side)
    # Depth is sampled, because a mean of two surfaces would be a point in the air. Color is averaged.
    meters = (depth[rows][:, columns] / np.float32(UNITS_A_METER)).astype(np.float32)
    color = cv2.resize(np.ascontiguousarray(strip), (6 * side, side), interpolation=cv2.INTER_AREA)
    kept = (meters > 0.2) & (meters < _REACH)
    points = np.array(viewpoint.position, np.float32) + _directions(side)[kept] * meters[kept][:, None]
    underfoot = floor_patch(viewpoint, strip, depth / np.float32(UNITS_A_METER))
    labels = None if labeler is None else _labels(strip, labeler)[rows][:, columns][kept]
    return ViewFromViewpoint(viewpoint, meters, points.astype(np.float32), color[kept], underfoot, labels)


def _labels(strip: NDArray[np.uint8], labeler: Labeler) -> NDArray[np.uint8]:
    """Returns (S, 6 S) numbers of objects of a strip (S, 6 S, 3), 0 in the faces that look up or down."""
    side = strip.shape[0]
    found = np.zeros(strip.shape[:2], np.uint8)
    for face, axes in enumerate(face_axes()):
        if abs(axes[1, 2]) < 0.5:  # the forward direction of the face is level
            part = np.s_[:, face * side : (face + 1) * side]
            found[part] = labeler(np.ascontiguousarray(strip[part]))
    return found


@cache
def _directions(side: int) -> NDArray[np.float32]:
    """Returns (side, 6 side, 3) float32 unit directions of a strip's pixels, world, for a pose that faces +y."""
    rays = face_rays(side) @ camera_pose(np.zeros(3), 0.0)[:3, :3].T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.ascontiguousarray(np.concatenate(list(rays), axis=1), np.float32)
