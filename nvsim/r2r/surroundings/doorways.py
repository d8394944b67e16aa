"""Detects doorways and corridors from walls and lintels, the surfaces just below the ceiling."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.surroundings.layers import CELL, Layers

Kind = Literal["room", "corridor", ""]
_JAMB = 0.85  # largest distance in meters from the center of a doorway to its jambs
_WIDE = 1.5  # largest width of a doorway in meters
_THICK = 0.6  # largest thickness of a lintel in meters
_BAND = (-0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15)  # meters off the line between the jambs
_SPANNED = 0.75  # smallest share of that line with a lintel
_BEYOND = 0.5  # meters before and behind a doorway at which the space is wider than the doorway
_WIDENS = 0.2  # meters by which it is wider
_DIRECTIONS = 36  # directions over half a turn
_FAR = 9.0  # length of rays in meters
_LEAST, _CORRIDOR, _LONG = 0.8, 2.3, 5.5  # meters: smallest and largest width of a corridor, and its smallest length
_BEND = 2.6  # largest width in meters of a corridor that bends or branches
_ROOM = 2.9  # smallest width of a room in meters
_WALL_LENGTH = 1.5  # smallest length of a wall in meters
_GAP = 5  # cells; walls with few rays have gaps


def doorways_between(
    walls: NDArray[np.bool_], standing: NDArray[np.bool_], layers: Layers, a: NDArray[np.floating],
    b: NDArray[np.floating],
) -> list[float]:  # fmt: skip
    """Returns the distances in meters from `a` (2,) at which the line to `b` (2,), meters, crosses a doorway.

    A doorway is a lintel between two jambs.

    walls     (rows, columns) cells with surfaces just below the ceiling
    standing  (rows, columns) cells with obstacles
    """
    length = float(np.linalg.norm(b - a))
    if length < 0.2:
        return []
    ahead = (b - a) / length
    across = np.array([ahead[1], -ahead[0]])
    along = np.arange(0.0, length, CELL / 2)
    over = layers.values_at(walls, a + along[:, None] * ahead)
    found = []
    solid = walls & standing
    for first, last in _runs(np.asarray(over)):
        middle = (along[first] + along[last]) / 2
        if along[last] - along[first] > _THICK:
            continue
        # A jamb reaches from the floor to the ceiling, in line with the lintel, which may be oblique to the line.
        jambs = [_to_jamb(solid, layers, a + middle * ahead, across, ahead, side) for side in (1, -1)]
        if jambs[0] is None or jambs[1] is None:
            continue
        gaps = [float(np.linalg.norm(jamb)) for jamb in jambs if jamb is not None]
        if sum(gaps) > _WIDE or not _has_lintel(
            walls, layers, a + middle * ahead + jambs[0], a + middle * ahead + jambs[1]
        ):
            continue
        # In a corridor with a beam or a lamp, the walls continue on both sides of it.
        beyond = [a + (along[i] + off) * ahead for i, off in ((first, -_BEYOND), (last, _BEYOND))]
        if all(_width(solid, layers, place, across) >= sum(gaps) + _WIDENS for place in beyond):
            found.append(float(middle))
    return found


def _to_jamb(
    solid: NDArray[np.bool_], layers: Layers, place: NDArray[np.floating], across: NDArray[np.floating],
    ahead: NDArray[np.floating], side: int,
) -> NDArray[np.float64] | None:  # fmt: skip
    """Returns the way (2,) in meters to the nearest jamb on a side, within 40 degrees of perpendicular, if any."""
    reach = np.arange(CELL, _JAMB + CELL, CELL / 2)
    best, found = math.inf, None
    for oblique in np.radians((0, -20, 20, -40, 40)):
        way = side * math.cos(oblique) * across + math.sin(oblique) * ahead
        hits = np.flatnonzero(layers.values_at(solid, place + reach[:, None] * way))
        if len(hits) and reach[hits[0]] < best:
            best, found = float(reach[hits[0]]), np.asarray(reach[hits[0]] * way)
    return found


def _has_lintel(
    walls: NDArray[np.bool_], layers: Layers, one: NDArray[np.floating], other: NDArray[np.floating]
) -> bool:  # fmt: skip
    """Whether a lintel leads from one jamb (2,), meters, to the other; a lamp or an artifact does not."""
    along = np.linspace(0.0, 1.0, max(2, round(float(np.linalg.norm(other - one)) / CELL)))[:, None]
    across = np.array([one[1] - other[1], other[0] - one[0]]) / max(1e-6, float(np.linalg.norm(other - one)))
    hits = [layers.values_at(walls, one + along * (other - one) + off * across) for off in _BAND]
    return float(np.any(hits, axis=0).mean()) >= _SPANNED


def _width(
    solid: NDArray[np.bool_], layers: Layers, place: NDArray[np.floating], across: NDArray[np.floating]
) -> float:  # fmt: skip
    """Returns the meters between the walls on both sides of a place (2,), at most 4 m."""
    reach = np.arange(0.0, 2.0, CELL / 2)
    sides = [np.flatnonzero(layers.values_at(solid, place + sign * reach[:, None] * across)) for sign in (1, -1)]
    return sum(float(reach[hits[0]]) if len(hits) else 2.0 for hits in sides)


def _runs(values: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Returns first and last index of every run of True, without runs at the begin or end of the array."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], values, [False]]).astype(np.int8)))
    runs = [(int(i), int(j) - 1) for i, j in zip(edges[::2], edges[1::2])]
    return [(i, j) for i, j in runs if i > 0 and j < len(values) - 1]


def kinds_of(walls: NDArray[np.bool_], layers: Layers, places: NDArray[np.floating]) -> list[Kind]:
    """Returns for places (N, 2), meters, whether they are in a room or a corridor; "" if unclear.

    A room has space for a disc of 2.9 m that covers the place. A corridor is long, and a disc of 2.6 m has no space in
    it. If a room and a corridor are open to each other, the room is unclear.
    """
    from scipy.ndimage import label

    firm = without_islands(walls)
    closed, _ = label(~_dilate(firm, _GAP))  # regions enclosed by walls and lintels
    narrow, _ = label(~firm & ~_cells_of_free_discs(firm, _BEND))
    roomy = layers.values_at(_cells_of_free_discs(firm, _ROOM), places)
    regions, strips = layers.values_at(closed, places), layers.values_at(narrow, places)
    long = {strip for strip in set(strips.tolist()) - {0} if _longest(narrow == strip) >= _LONG}
    corridor = [strip in long or _is_corridor(walls, layers, place) for strip, place in zip(strips.tolist(), places)]
    mixed = {region for region, here in zip(regions.tolist(), corridor) if here} | {0}
    return [
        "corridor" if here else "room" if wide and region not in mixed else ""
        for here, wide, region in zip(corridor, roomy, regions.tolist())
    ]


def without_islands(walls: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Removes components of walls (rows, columns) that are too short for one, such as lamps and artifacts."""
    import cv2

    _, labels, sizes, _ = cv2.connectedComponentsWithStats(_dilate(walls, 3).astype(np.uint8), connectivity=8)
    longer = sizes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1) * CELL
    return np.asarray(walls & (longer >= _WALL_LENGTH)[labels])


def _dilate(walls: NDArray[np.bool_], side: int) -> NDArray[np.bool_]:
    import cv2

    return cv2.dilate(walls.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)


def _cells_of_free_discs(walls: NDArray[np.bool_], diameter: float) -> NDArray[np.bool_]:
    """Returns (rows, columns) the cells covered by discs of this diameter in meters that touch no wall."""
    from scipy.ndimage import distance_transform_edt

    radius = diameter / 2 / CELL
    return np.asarray(distance_transform_edt(distance_transform_edt(~walls) < radius) < radius)


def _longest(mine: NDArray[np.bool_]) -> float:
    """Returns the longer side in meters of the bounding box of the cells."""
    rows, columns = np.nonzero(mine)
    return float(max(np.ptp(rows), np.ptp(columns)) + 1) * CELL


def _is_corridor(walls: NDArray[np.bool_], layers: Layers, place: NDArray[np.floating]) -> bool:
    """Whether the place is between long parallel walls."""
    half = np.arange(_DIRECTIONS) * math.pi / _DIRECTIONS
    ways = np.stack([np.sin(half), np.cos(half)], axis=1)
    widths = [_length_between_walls(walls, layers, place, way) for way in ways]
    narrow = int(np.argmin(widths))
    across, along = ways[narrow], ways[(narrow + _DIRECTIONS // 2) % _DIRECTIONS]
    if not _LEAST < widths[narrow] <= _CORRIDOR or _length_between_walls(walls, layers, place, along) < _LONG:
        return False
    # A chord across a corner is also short, but its neighbors are not. At a crossing, one neighbor may be long.
    beside = [
        _length_between_walls(walls, layers, place + off * along, across) for off in (-1.2, -0.8, -0.4, 0.4, 0.8, 1.2)
    ]
    return sum(abs(width - widths[narrow]) < 0.5 for width in beside) >= 5


def _length_between_walls(
    walls: NDArray[np.bool_], layers: Layers, place: NDArray[np.floating], way: NDArray[np.floating]
) -> float:
    """Returns the length in meters of the line through a place (2,) from wall to wall."""
    return sum(_to_wall(walls, layers, place, sign * way) for sign in (1, -1))


def _to_wall(walls: NDArray[np.bool_], layers: Layers, place: NDArray[np.floating], way: NDArray[np.floating]) -> float:
    reach = np.arange(0.0, _FAR, CELL / 2)
    hits = np.flatnonzero(layers.values_at(walls, np.asarray(place)[:2] + reach[:, None] * way))
    return float(reach[hits[0]]) if len(hits) else _FAR
