"""The surroundings of the viewpoints of a scan, and of each step between them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic
from nvsim.graph.types import NavGraph
from nvsim.r2r.surroundings.doorways import Kind, doorways_between, kinds_of, without_islands
from nvsim.r2r.surroundings.floor_kinds import floor_along, floor_kinds
from nvsim.r2r.surroundings.floor_objects import FloorObject, find_floor_objects, walls_of
from nvsim.r2r.surroundings.layers import CELL, Layers
from nvsim.r2r.surroundings.visibility import ViewFromViewpoint

Side = Literal["left", "right"]
Pair = tuple[str, str]
SAME_DOORWAY = 0.8
"""Two lintels closer than this many meters are one doorway."""
NEAR = 2.2
"""Largest distance in meters from a viewpoint to an object near it."""
_BESIDE = 1.9  # largest distance in meters from the way to an object that it passes
_FAR = 6.0  # largest distance in meters at which objects are named
_AT_WALL = 0.35  # meters; an object may be this close to a wall of its own room
_OPEN = 0.3  # smallest share of an object that must be visible


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The surroundings of a scan. A step (from, to) is one direction of an edge.

    things   objects of all storeys
    kinds    viewpoint id -> room or corridor
    visible  viewpoint id -> objects in the same room within 6 m: index, radians from +y to the right, meters
    passed   (from, to) -> objects beside the step that are visible from its start: index, side, meters along the step
    meters   (from, to) -> length of the step in meters, seen from above
    doors    (from, to) -> distances in meters of doorways along the step
    floors   (from, to) -> names in FLOORS of the floor along the step, 0.2 m apart
    """

    things: tuple[FloorObject, ...] = ()
    kinds: Mapping[str, Kind] = field(default_factory=dict)
    visible: Mapping[str, tuple[tuple[int, float, float], ...]] = field(default_factory=dict)
    passed: Mapping[Pair, tuple[tuple[int, Side, float], ...]] = field(default_factory=dict)
    meters: Mapping[Pair, float] = field(default_factory=dict)
    doors: Mapping[Pair, tuple[float, ...]] = field(default_factory=dict)
    floors: Mapping[Pair, tuple[str, ...]] = field(default_factory=dict)


def surroundings_of(graph: NavGraph, storeys: list[Layers], known: Sequence[str] = ()) -> Surroundings:
    """Computes the surroundings from the storeys of the scan. Steps on stairs have none. `known` are the names of the
    objects that the views label."""
    things: list[FloorObject] = []
    kinds: dict[str, Kind] = {}
    visible: dict[str, tuple[tuple[int, float, float], ...]] = {}
    passed: dict[Pair, tuple[tuple[int, Side, float], ...]] = {}
    lengths: dict[Pair, float] = {}
    doors: dict[Pair, tuple[float, ...]] = {}
    floors: dict[Pair, tuple[str, ...]] = {}
    for layers in storeys:
        at = {one.viewpoint.id: np.array(one.viewpoint.position) for one in layers.seen}
        first, here = len(things), find_floor_objects(layers, known)
        things += here
        walls, standing = walls_of(layers), layers.count_between(0.4, 1.7) >= 4
        kinds_of_floor = floor_kinds(layers, walls)
        sees = {one.viewpoint.id: _seen_by(one, here) for one in layers.seen}
        firm = without_islands(walls)
        for id, place in at.items():  # objects in the next room are neither near nor passed
            sees[id] -= {i for i in sees[id] if is_behind_a_wall(firm, layers, place[:2], here[i])}
        kinds |= dict(zip(at, kinds_of(walls, layers, np.array([place[:2] for place in at.values()]))))
        for id, place in at.items():
            visible[id] = tuple((first + i, *where) for i, where in _places_of_objects(place, here, sees[id]))
        for a, b in graph.edges:
            if a not in at or b not in at:
                continue
            length = float(np.linalg.norm(at[b][:2] - at[a][:2]))
            through = doorways_between(walls, standing, layers, at[a][:2], at[b][:2])
            along = floor_along(kinds_of_floor, layers, at[a][:2], at[b][:2])
            lengths[a, b] = lengths[b, a] = length
            doors[a, b], floors[a, b] = tuple(through), along
            doors[b, a], floors[b, a] = tuple(length - m for m in reversed(through)), along[::-1]
            for pair in ((a, b), (b, a)):
                beside = _objects_beside_path(at[pair[0]], at[pair[1]], here, sees[pair[0]])
                start, ahead = at[pair[0]][:2], (at[pair[1]] - at[pair[0]])[:2] / max(length, 1e-9)
                passed[pair] = tuple(
                    (first + i, side, meters)
                    for i, side, meters in beside
                    if not is_behind_a_wall(firm, layers, start + min(meters, length) * ahead, here[i])
                )
    return Surroundings(tuple(things), kinds, visible, passed, lengths, doors, floors)


def _seen_by(one: ViewFromViewpoint, things: list[FloorObject]) -> set[int]:
    """Returns the indices of objects of which a viewpoint sees enough."""
    found = set()
    for i, thing in enumerate(things):
        if np.hypot(*(thing.middle - one.viewpoint.position[:2])) < _FAR:
            some = thing.points[:: max(1, len(thing.points) // 200)]
            if one.visible_and_passed(some)[0].mean() >= _OPEN:
                found.add(i)
    return found


def is_behind_a_wall(
    walls: NDArray[np.bool_], layers: Layers, place: NDArray[np.floating], thing: FloorObject
) -> bool:  # fmt: skip
    """Whether a wall or a lintel is between a place (2,), meters, and the nearest part of an object."""
    nearest = thing.cells[np.hypot(*(thing.cells - place).T).argmin()]
    length = float(np.linalg.norm(nearest - place))
    if length <= 2 * _AT_WALL:
        return False
    along = np.arange(_AT_WALL, length - _AT_WALL, CELL / 2)
    return bool(layers.values_at(walls, place + along[:, None] * (nearest - place) / length).any())


def _places_of_objects(
    place: NDArray[np.float64], things: list[FloorObject], seen: set[int]
) -> Iterator[tuple[int, tuple[float, float]]]:
    for i in sorted(seen):
        meters = float(np.hypot(*(things[i].cells - place[:2]).T).min())
        x, y = things[i].middle - place[:2]
        yield i, (math.atan2(x, y), meters)


def _objects_beside_path(
    a: NDArray[np.float64], b: NDArray[np.float64], things: list[FloorObject], seen: set[int]
) -> Iterator[tuple[int, Side, float]]:
    """Yields objects that are clearly on one side of the way from `a` to `b`, not ahead of it or behind it."""
    length = float(np.linalg.norm(b[:2] - a[:2]))
    if length < 0.3:
        return
    ahead = (b[:2] - a[:2]) / length
    across = np.array([ahead[1], -ahead[0]])
    for i in sorted(seen):
        way, off = (things[i].cells - a[:2]) @ ahead, (things[i].cells - a[:2]) @ across
        clear = off.min() > 0.2 or off.max() < -0.2
        if clear and 0.2 < way.mean() < length + 0.2 and np.abs(off).min() < _BESIDE:
            yield i, "right" if off.min() > 0 else "left", float(way.mean())


def write_surroundings(path: Path, scans: Mapping[str, Surroundings]) -> Path:
    """Writes {scan: {things, kinds, near, doorways}}; places in meters, world; headings in radians, 0 is +y. Raises
    InputError if writing fails."""
    atomic.write_text(path, json.dumps({scan: _data(seen) for scan, seen in scans.items()}, indent=1) + "\n")
    return path


def _data(seen: Surroundings) -> dict[str, Any]:
    things = [
        {
            "colour": thing.color,
            "shape": thing.shape,
            "place": thing.middle.round(2).tolist(),
            "sides": [round(side, 2) for side in thing.sides],
            "top": round(thing.top, 2),
        }
        for thing in seen.things
    ]
    doorways = [
        {"from": a, "to": b, "metres": [round(m, 2) for m in meters]} for (a, b), meters in seen.doors.items() if meters
    ]
    near = {
        id: [{"thing": i, "heading": round(heading, 3), "metres": round(m, 2)} for i, heading, m in found if m <= NEAR]
        for id, found in seen.visible.items()
    }
    kinds = {id: kind for id, kind in seen.kinds.items() if kind}
    return {
        "things": things,
        "kinds": kinds,
        "near": {id: found for id, found in near.items() if found},
        "doorways": doorways,
    }
