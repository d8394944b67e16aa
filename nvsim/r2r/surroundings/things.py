"""Detects objects on the floor: patches of one color, with a size and shape that can be named, seen by most views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.surroundings.colour_names import COLOURS, NAMELESS, lab_of, names_of
from nvsim.r2r.surroundings.layers import CELL, Layers

Shape = Literal["tall", "waist-high", "low", "sofa", "table", "platform", "object"]
_FROM = 0.11  # meters above the floor; lower voxels belong to the floor
_TALL, _WAIST, _FLAT = 1.45, 0.66, 0.26  # heights of the top in meters
_TALLEST = 2.15
_LEGS = 0.12  # largest share of a table's rim that legs close
_FURNITURE = 1.3  # smallest longer side in meters of a piece of furniture
_NAMED = tuple(name for name in COLOURS if name not in ("white", "grey", "black"))
"""Colors of objects. Gray is missing, because it may be white in the shade."""
_WALL = 3  # voxels below the ceiling that make a wall cell
_LEAST_CELLS, _LEAST_OF_A_FRONT = 32, 14  # cells of an object; of an object above eye height, if only its front is seen
_FRONT = 1.3  # smallest height of its top in meters
_WHOLE = 0.4  # smallest visible share of a front
_MOST_CELLS = 3600
_SHORTEST, _LONGEST = 0.4, 3.0  # smallest and largest longer side in meters
_THINNEST = 0.15  # smallest shorter side in meters
_FIRM = 0.75  # smallest share of views that end at its voxels and do not pass them
_NEAR_TOP, _AT_TOP = 0.3, 0.1  # meters below the top; smallest share of cells whose own color reaches that height
_ONE_COLOUR = 0.6  # smallest share of its color among its voxels with a color name
_ALONE = 0.3  # largest share of surrounding cells with another object; otherwise it is a part of that object


@dataclass(frozen=True, eq=False)
class Thing:
    """An object on the floor.

    colour   a name in COLOURS
    shape    its appearance by size and outline
    cells    (n, 2) meters, world x, y of the centers of its cells
    points   (m, 3) points on it, meters, world
    top      meters above the floor
    sides    (longer, shorter) meters
    """

    colour: str
    shape: Shape
    cells: NDArray[np.float64]
    points: NDArray[np.float64]
    top: float
    sides: tuple[float, float]

    @property
    def middle(self) -> NDArray[np.float64]:
        """(2,) meters, world."""
        return np.asarray(self.cells.mean(axis=0))

    @property
    def look(self) -> tuple[str, Shape]:
        return self.colour, self.shape


def walls_of(layers: Layers) -> NDArray[np.bool_]:
    """Returns (rows, columns) bool: cells with surfaces just below the ceiling, which are walls and lintels."""
    return layers.between(*layers.high) >= _WALL


def find_things(layers: Layers) -> list[Thing]:
    """Returns the objects of a storey that have a name, the largest first."""
    import cv2

    tallest = min(_TALLEST, layers.high[0])
    walls = cv2.dilate(walls_of(layers).astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    above = layers.above
    standing = (above > _FROM) & (above < tallest)
    standing &= ~walls[layers.voxels[:, 1], layers.voxels[:, 0]]
    rows = np.flatnonzero(standing)
    if not len(rows):
        return []
    names = _smooth_names(layers, rows)
    flat = layers.voxels[rows, 1].astype(np.int64) * layers.shape[1] + layers.voxels[rows, 0]
    taken = np.zeros(layers.shape[0] * layers.shape[1], np.uint8)
    taken[flat] = 1
    taken = taken.reshape(layers.shape)
    found = []
    for colour in _NAMED:
        i = COLOURS.index(colour)
        mine = names == i
        mask = np.zeros(layers.shape[0] * layers.shape[1], np.uint8)
        mask[flat[mine]] = 1
        closed = cv2.morphologyEx(mask.reshape(layers.shape), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        count, labels, sizes, _ = cv2.connectedComponentsWithStats(closed, connectivity=4)
        label = labels.reshape(-1)[flat]
        for k in range(1, count):
            if not _LEAST_OF_A_FRONT <= sizes[k, cv2.CC_STAT_AREA] <= _MOST_CELLS or not _stands_alone(
                labels == k, taken
            ):
                continue
            thing = _thing(layers, rows[label == k], names[label == k] == i, names[label == k], colour)
            if thing is not None:
                found.append(thing)
    return sorted(found, key=lambda thing: -len(thing.cells))


def _stands_alone(mine: NDArray[np.bool_], taken: NDArray[np.uint8]) -> bool:
    """Whether the cells around an object are mostly free or walls."""
    import cv2

    around = cv2.dilate(mine.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool) & ~mine
    return float(taken[around].mean()) <= _ALONE


def _smooth_names(layers: Layers, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns (n,) color names of voxels, averaged with their neighbors because of wood grain and books in shelves."""
    from scipy.spatial import cKDTree

    lab = lab_of(layers.colours[rows])
    tree = cKDTree(layers.voxels[rows].astype(np.float32))
    _, near = tree.query(layers.voxels[rows].astype(np.float32), k=min(12, len(rows)), distance_upper_bound=3.0)
    padded = np.concatenate([lab, np.zeros((1, 3), np.float32)])
    weight = (near < len(rows)).astype(np.float32)
    mean = (padded[near] * weight[..., None]).sum(axis=1) / weight.sum(axis=1)[:, None]
    return names_of(mean)


def _thing(
    layers: Layers, rows: NDArray[np.int64], of_colour: NDArray[np.bool_], names: NDArray[np.int64], colour: str
) -> Thing | None:
    """Returns the object made of the voxels `rows`, or None if it cannot be named reliably."""
    import cv2

    voxels = layers.voxels[rows]
    cells, back = np.unique(voxels[:, :2], axis=0, return_inverse=True)
    back = back.reshape(-1)
    if of_colour.sum() < _ONE_COLOUR * max(1, (names != NAMELESS).sum()):
        return None
    if of_colour.sum() < 0.4 * len(rows):
        return None
    (_, sides, _) = cv2.minAreaRect(cells.astype(np.float32))
    longer, shorter = (max(sides) + 1) * CELL, (min(sides) + 1) * CELL
    heights = layers.above[rows]
    tops = np.zeros(len(cells))
    np.maximum.at(tops, back, heights)
    top = float(np.quantile(tops, 0.9))
    front = top >= _FRONT and len(rows) * CELL >= _WHOLE * len(cells) * (top - _FROM)
    if not _SHORTEST <= longer <= _LONGEST or not front and (shorter < _THINNEST or len(cells) < _LEAST_CELLS):
        return None
    shape = _shape(cells, tops, heights, back, top, longer, shorter, colour, front)
    if shape is None:
        return None
    points = layers.places_of(rows[of_colour])
    own = np.zeros(len(cells))
    np.maximum.at(own, back[of_colour], heights[of_colour])
    if (own[own > 0] > top - _NEAR_TOP).mean() < _AT_TOP:
        return None  # the top is another object, or an artifact above this one
    if not _is_firm(layers, points):
        return None
    return Thing(colour, shape, layers.centres_of(cells[:, ::-1]), points, top, (longer, shorter))


def _shape(
    cells: NDArray[np.int32],
    tops: NDArray[np.float64],
    heights: NDArray[np.float32],
    back: NDArray[np.int64],
    top: float,
    longer: float,
    shorter: float,
    colour: str,
    front: bool,
) -> Shape | None:
    """Returns the shape of an object, or None.

    tops      (n,) heights of its `cells`
    heights   (m,) heights of its voxels, which are in the cells `back` (m,)
    front     whether possibly only the front is seen
    """
    fill = len(cells) * CELL * CELL / (longer * shorter)
    if fill < 0.4 and not front:
        return None  # scattered or L-shaped
    level = float(np.median(tops))
    if level < _FLAT:
        alike = float((tops < _FLAT).mean())
        return "platform" if alike > 0.85 and longer * shorter > 0.8 and fill > 0.6 and longer > 1.2 else None
    if longer < _FURNITURE or colour == "green":  # plants are not furniture
        return "object" if top > 0.5 else None
    if top >= _TALL:
        return "tall"
    lowest = np.full(len(cells), np.inf)
    np.minimum.at(lowest, back, heights)
    flat = np.abs(tops - level) < 0.09
    closed = (lowest < level - 0.2)[_is_rim(cells)]  # rim cells in which a side below the edge is seen
    if 0.3 < level < 0.85 and shorter > 0.4 and flat.mean() > 0.75 and closed.mean() < _LEGS:
        return "table"
    seat, rest = (tops > 0.28) & (tops < 0.56), tops > 0.6
    cloth = colour not in ("brown", "beige")
    if cloth and longer > 1.4 and shorter > 0.6 and top < 1.05 and seat.mean() > 0.3 and rest.mean() > 0.15:
        return "sofa"
    return "waist-high" if top >= _WAIST else "low"


def _is_rim(cells: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Returns (n,) whether cells (n, 2) have a neighbor outside the object."""
    keys = cells[:, 0].astype(np.int64) << 32 | cells[:, 1]
    around = [np.isin(keys + step, keys) for step in (1, -1, 1 << 32, -(1 << 32))]
    return ~np.logical_and.reduce(around)


def _is_firm(layers: Layers, points: NDArray[np.float64]) -> bool:
    """Whether nearby viewpoints see the points (N, 3) and do not see past them."""
    some = points[:: max(1, len(points) // 150)]
    middle, near = some[:, :2].mean(axis=0), []
    for one in layers.seen:
        far = float(np.hypot(*(middle - one.viewpoint.position[:2])))
        if far < 5.0:
            near.append(one)
    on = past = 0
    for one in near:
        there, beyond = one.visible_and_passed(some)
        on, past = on + int(there.sum()), past + int(beyond.sum())
    return on > len(some) and on >= _FIRM * (on + past)
