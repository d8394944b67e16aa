"""Doorways and corridors, by what reaches below the ceiling: walls, and the lintels of doors."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.surroundings.layers import CELL, Layers

Kind = Literal["room", "corridor", ""]
_JAMB = 0.85  # metres from the middle of a doorway to its jambs, at most
_WIDE = 1.5  # metres of a doorway, at most
_THICK = 0.6  # metres of a lintel, at most
_DIRECTIONS = 36  # over half a turn
_FAR = 9.0  # metres
_LEAST, _CORRIDOR, _LONG = 0.8, 2.3, 5.5  # metres: width of a corridor, from, to; its length, at least
_BEND = 2.6  # metres of a corridor that bends or branches, at most
_ROOM = 2.9  # metres: width of a room, at least
_WALL_LENGTH = 1.5  # metres
_GAP = 5  # cells; walls that few rays meet have holes


def doorways_between(
    walls: NDArray[np.bool_], standing: NDArray[np.bool_], layers: Layers, a: NDArray[np.floating],
    b: NDArray[np.floating],
) -> list[float]:  # fmt: skip
    """Metres from `a` (2,) at which the straight way to `b` (2,) passes below a lintel between two jambs.

    walls     (rows, columns) what reaches below the ceiling
    standing  (rows, columns) what stands in one's way
    """
    length = float(np.linalg.norm(b - a))
    if length < 0.2:
        return []
    ahead = (b - a) / length
    across = np.array([ahead[1], -ahead[0]])
    along = np.arange(0.0, length, CELL / 2)
    over = layers.values_at(walls, a + along[:, None] * ahead)
    found = []
    for first, last in _runs(np.asarray(over)):
        middle = (along[first] + along[last]) / 2
        if along[last] - along[first] > _THICK:
            continue
        # A jamb stands from the floor to the ceiling, in the line of the lintel, which may be oblique to the way.
        gaps = [_to_jamb(walls & standing, layers, a + middle * ahead, across, ahead, side) for side in (1, -1)]
        if max(gaps) <= _JAMB and sum(gaps) <= _WIDE:
            found.append(float(middle))
    return found


def _to_jamb(
    solid: NDArray[np.bool_], layers: Layers, place: NDArray[np.floating], across: NDArray[np.floating],
    ahead: NDArray[np.floating], side: int,
) -> float:  # fmt: skip
    """Metres to the nearest jamb on a side, within 40 degrees of straight across; infinite where there is none."""
    reach = np.arange(CELL, _JAMB + CELL, CELL / 2)
    best = math.inf
    for oblique in np.radians((0, -20, 20, -40, 40)):
        way = side * math.cos(oblique) * across + math.sin(oblique) * ahead
        hits = np.flatnonzero(layers.values_at(solid, place + reach[:, None] * way))
        if len(hits):
            best = min(best, float(reach[hits[0]]))
    return best


def _runs(values: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of every run of True; runs that begin or end with the array are none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], values, [False]]).astype(np.int8)))
    runs = [(int(i), int(j) - 1) for i, j in zip(edges[::2], edges[1::2])]
    return [(i, j) for i, j in runs if i > 0 and j < len(values) - 1]


def kinds_of(walls: NDArray[np.bool_], layers: Layers, places: NDArray[np.floating]) -> list[Kind]:
    """Whether places (N, 2) are in a room, where a disc of 2.9 m covers them, or in a corridor, where none of 2.6 m
    does and which is long; "" where that is disputable, or a room and a corridor are open to each other."""
    from scipy.ndimage import label

    firm = _without_islands(walls)
    closed, _ = label(~_grown(firm, _GAP))  # by walls and lintels
    narrow, _ = label(~firm & ~_covered(firm, _BEND))
    roomy = layers.values_at(_covered(firm, _ROOM), places)
    regions, strips = layers.values_at(closed, places), layers.values_at(narrow, places)
    long = {strip for strip in set(strips.tolist()) - {0} if _longest(narrow == strip) >= _LONG}
    corridor = [strip in long or _is_corridor(walls, layers, place) for strip, place in zip(strips.tolist(), places)]
    mixed = {region for region, here in zip(regions.tolist(), corridor) if here} | {0}
    return [
        "corridor" if here else "room" if wide and region not in mixed else ""
        for here, wide, region in zip(corridor, roomy, regions.tolist())
    ]


def _without_islands(walls: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Without what is too short for a wall: lamps, and what reconstructions leave below ceilings."""
    import cv2

    _, labels, sizes, _ = cv2.connectedComponentsWithStats(_grown(walls, 3).astype(np.uint8), connectivity=8)
    longer = sizes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1) * CELL
    return np.asarray(walls & (longer >= _WALL_LENGTH)[labels])


def _grown(walls: NDArray[np.bool_], side: int) -> NDArray[np.bool_]:
    import cv2

    return cv2.dilate(walls.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)


def _covered(walls: NDArray[np.bool_], diameter: float) -> NDArray[np.bool_]:
    """(rows, columns) which cells discs of so many metres cover that no wall is in."""
    from scipy.ndimage import distance_transform_edt

    radius = diameter / 2 / CELL
    return np.asarray(distance_transform_edt(distance_transform_edt(~walls) < radius) < radius)


def _longest(mine: NDArray[np.bool_]) -> float:
    """Metres of the longer side of the cells' box."""
    rows, columns = np.nonzero(mine)
    return float(max(np.ptp(rows), np.ptp(columns)) + 1) * CELL


def _is_corridor(walls: NDArray[np.bool_], layers: Layers, place: NDArray[np.floating]) -> bool:
    """Whether walls run parallel on both sides, before and behind, and it is long."""
    half = np.arange(_DIRECTIONS) * math.pi / _DIRECTIONS
    ways = np.stack([np.sin(half), np.cos(half)], axis=1)
    widths = [_chord(walls, layers, place, way) for way in ways]
    narrow = int(np.argmin(widths))
    across, along = ways[narrow], ways[(narrow + _DIRECTIONS // 2) % _DIRECTIONS]
    if not _LEAST < widths[narrow] <= _CORRIDOR or _chord(walls, layers, place, along) < _LONG:
        return False
    # A chord that cuts off a corner is short too; those beside it are not. At a crossing one of them may be long.
    beside = [_chord(walls, layers, place + off * along, across) for off in (-1.2, -0.8, -0.4, 0.4, 0.8, 1.2)]
    return sum(abs(width - widths[narrow]) < 0.5 for width in beside) >= 5


def _chord(walls: NDArray[np.bool_], layers: Layers, place: NDArray[np.floating], way: NDArray[np.floating]) -> float:
    """Metres of the straight line through a place (2,) from wall to wall."""
    return sum(_to_wall(walls, layers, place, sign * way) for sign in (1, -1))


def _to_wall(walls: NDArray[np.bool_], layers: Layers, place: NDArray[np.floating], way: NDArray[np.floating]) -> float:
    reach = np.arange(0.0, _FAR, CELL / 2)
    hits = np.flatnonzero(layers.values_at(walls, np.asarray(place)[:2] + reach[:, None] * way))
    return float(reach[hits[0]]) if len(hits) else _FAR
