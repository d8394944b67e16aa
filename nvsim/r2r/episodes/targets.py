"""Objects as goals of navigation: their boxes in views, and places from which an agent can look at them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.r2r.episodes.episode_actions import FreeSpace
from nvsim.r2r.surroundings.doorways import without_islands
from nvsim.r2r.surroundings.floor_objects import FloorObject, walls_of
from nvsim.r2r.surroundings.layers import CELL, Layers
from nvsim.r2r.surroundings.survey import Surroundings, is_behind_a_wall

Box = tuple[int, int, int, int]
WIDTH, HEIGHT, VFOV = 640, 480, math.radians(60)
"""The views of MatterSim."""
HFOV = 2 * math.atan(math.tan(VFOV / 2) * WIDTH / HEIGHT)
REACH = 3.0
"""Largest distance in meters from a viewpoint to an object with boxes, as in REVERIE."""
CLOSE = 1.0
"""Largest distance in meters from an object to the places that end an episode, as in ObjectNav."""
_SHARE = 0.25  # smallest share of an object that a view must contain
_SMALLEST = 8  # smallest side of a box in pixels
_EVERY = 4  # cells between two places
_NEAREST = 0.05  # meters in front of the camera


@dataclass(frozen=True, eq=False)
class Targets:
    """The objects of a scan as goals; an object is its index in the surroundings.

    bottoms  world z of the floor under each object
    boxes    viewpoint id -> object -> boxes (left, top, width, height), pixels, by index of the 36 views
    places   object -> (N, 3) places on the floor within 1 m, meters, world, at which a robot touches nothing; objects
             without places are missing
    """

    things: tuple[FloorObject, ...] = ()
    bottoms: tuple[float, ...] = ()
    boxes: Mapping[str, Mapping[int, Mapping[int, Box]]] = field(default_factory=dict)
    places: Mapping[int, NDArray[np.float64]] = field(default_factory=dict)


def targets_of(
    graph: NavGraph, storeys: Sequence[Layers], seen: Surroundings, cloud: NDArray[np.floating] | None = None
) -> Targets:
    """Computes the goals among the objects of the surroundings `seen`.

    `cloud` is (N, 3) points on surfaces, meters, world, or None; see `FreeSpace.of`.
    """
    levels = [_storey_of(thing, storeys) for thing in seen.things]
    bottoms = tuple(storeys[level].floor for level in levels)
    boxes: dict[str, dict[int, dict[int, Box]]] = {}
    for id, visible in seen.visible.items():
        for i, _, meters in visible:
            if meters <= REACH and (found := _boxes_from(graph.viewpoints[id], seen.things[i], bottoms[i])):
                boxes.setdefault(id, {})[i] = found
    places: dict[int, NDArray[np.float64]] = {}
    for level, layers in enumerate(storeys):
        here = [i for i, other in enumerate(levels) if other == level]
        space, walls = FreeSpace.of(layers, graph, cloud) if here else None, without_islands(walls_of(layers))
        for i in here:
            assert space is not None
            found_places = _places_at(seen.things[i], space, walls)
            if len(found_places):
                places[i] = np.column_stack([found_places, np.full(len(found_places), layers.floor)])
    return Targets(seen.things, bottoms, boxes, places)


def box_in(camera: Camera, thing: FloorObject, bottom: float) -> tuple[Box, float] | None:
    """Returns the box of an object in an image, and the share of the object inside the image; None if it is behind the
    camera. `bottom` is the world z of the floor under it. Occlusion is ignored."""
    pixels, depth = camera.project(_outline(thing, bottom))
    front = depth > _NEAREST
    if not front.any():
        return None
    k = camera.intrinsics
    size = np.array([k.width, k.height])
    inside = front & (pixels >= 0).all(axis=1) & (pixels < size).all(axis=1)
    low, high = pixels[front].min(axis=0).clip(0, size), pixels[front].max(axis=0).clip(0, size)
    (x, y), (right, below) = np.floor(low).astype(int).tolist(), np.ceil(high).astype(int).tolist()
    return (x, y, right - x, below - y), float(inside.mean())


def angles_of(position: Sequence[float], thing: FloorObject, bottom: float) -> tuple[float, float, float, float]:
    """Returns the smallest and largest heading and elevation of an object from `position`, radians as in MatterSim.

    The middle of the headings is in [0, 2 pi), so an object ahead has a negative heading on its left. `position` is in
    meters, world, and `bottom` is the world z of the floor under the object.
    """
    away = _outline(thing, bottom) - np.array(position)
    elevation = np.arctan2(away[:, 2], np.hypot(away[:, 0], away[:, 1]))
    middle = math.atan2(*(thing.middle - np.array(position[:2])))
    beside = (np.arctan2(away[:, 0], away[:, 1]) - middle + math.pi) % (2 * math.pi) - math.pi
    left, right = middle + float(beside.min()), middle + float(beside.max())
    turn = (left + right) / 2 // (2 * math.pi) * 2 * math.pi
    return left - turn, right - turn, float(elevation.min()), float(elevation.max())


def _outline(thing: FloorObject, bottom: float) -> NDArray[np.float64]:
    """Returns (N, 3) the corners of the cells of an object at its bottom, middle, and top, meters, world."""
    corners = thing.cells[:, None] + np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]]) * CELL
    xy = np.tile(corners.reshape(-1, 2), (3, 1))
    z = np.repeat([bottom, bottom + thing.top / 2, bottom + thing.top], len(xy) // 3)
    return np.column_stack([xy, z])


def camera_at(position: Sequence[float], heading: float, elevation: float = 0.0) -> Camera:
    """Returns a camera with MatterSim's views; `position` in meters, world, angles in radians."""
    return Camera(Intrinsics.from_fov(WIDTH, HEIGHT, HFOV), camera_pose(np.array(position), heading, elevation))


def _boxes_from(viewpoint: Viewpoint, thing: FloorObject, bottom: float) -> dict[int, Box]:
    found = {}
    for view in range(36):
        heading, elevation = math.radians(30 * (view % 12)), math.radians(30 * (view // 12 - 1))
        one = box_in(camera_at(viewpoint.position, heading, elevation), thing, bottom)
        if one is not None and one[1] >= _SHARE and min(one[0][2:]) >= _SMALLEST:
            found[view] = one[0]
    return found


def _storey_of(thing: FloorObject, storeys: Sequence[Layers]) -> int:
    highest = float(thing.points[:, 2].max()) - thing.top
    return min(range(len(storeys)), key=lambda level: abs(storeys[level].floor - highest))


def _places_at(thing: FloorObject, space: FreeSpace, walls: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Returns (N, 2) free places near an object, without a wall between."""
    layers = space.layers
    rows, columns = np.mgrid[0 : layers.shape[0] : _EVERY, 0 : layers.shape[1] : _EVERY]
    centers = layers.centers_of(np.stack([rows.ravel(), columns.ravel()], axis=1))
    centers = centers[np.hypot(*(centers - thing.middle).T) <= CLOSE + max(thing.sides)]
    near = np.array([np.hypot(*(thing.cells - center).T).min() <= CLOSE for center in centers], bool)
    free = near & space.is_free(centers) if len(centers) else near
    kept = [center for center in centers[free] if not is_behind_a_wall(walls, layers, center, thing)]
    return np.array(kept, np.float64).reshape(-1, 2)
