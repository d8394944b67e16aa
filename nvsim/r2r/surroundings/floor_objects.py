"""Detects objects on the floor, seen by most views: parts that a network names, and patches of one color with a size
and shape that can be named."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.surroundings.layers import CELL, Layers, labels_of_voxels
from nvsim.r2r.surroundings.naming import COLORS, NAMELESS, Outline, lab_of, names_of, shape_of

_FROM = 0.11  # meters above the floor; lower voxels belong to the floor
_TALLEST = 2.15
_NAMED = tuple(name for name in COLORS if name not in ("white", "gray", "black"))
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
_ONE_COLOR = 0.6  # smallest share of its color among its voxels with a color name, except for a bookshelf
_LEAST_OF_ITS_COLOR = 0.25  # smallest share of its color among all its voxels
_HANGS = 0.9  # meters above the floor; an object that begins higher hangs
_COVERED = 0.3  # share of its cells from which on an object is a part of one that a network names
_ALONE = 0.3  # largest share of surrounding cells with another object; otherwise it is a part of that object


@dataclass(frozen=True, eq=False)
class FloorObject:
    """An object on the floor.

    color    a name in COLORS, "" if it has several or the name is disputable
    shape    a Shape by its size and outline, or the name that a network gives it
    cells    (n, 2) meters, world x, y of the centers of its cells
    points   (m, 3) points on it, meters, world
    top      meters above the floor
    sides    (longer, shorter) meters
    """

    color: str
    shape: str
    cells: NDArray[np.float64]
    points: NDArray[np.float64]
    top: float
    sides: tuple[float, float]

    @property
    def middle(self) -> NDArray[np.float64]:
        """(2,) meters, world."""
        return np.asarray(self.cells.mean(axis=0))

    @property
    def color_and_shape(self) -> tuple[str, str]:
        return self.color, self.shape


def walls_of(layers: Layers) -> NDArray[np.bool_]:
    """Returns (rows, columns) bool: cells with surfaces just below the ceiling, which are walls and lintels."""
    return layers.count_between(*layers.high) >= _WALL


def find_floor_objects(layers: Layers, known: Sequence[str] = ()) -> list[FloorObject]:
    """Returns the objects of a storey that have a name, the largest first. `known` are the names that belong to the
    labels of the views; such a part is not named by its color and shape too."""
    import cv2

    tallest = min(_TALLEST, layers.high[0])
    walls = cv2.dilate(walls_of(layers).astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    above = layers.height_above_floor
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
    found = list(_labeled_objects(layers, rows, names, known)) if known else []
    labeled = np.zeros(layers.shape, bool)
    for one in found:
        labeled[tuple(layers.cells_of(one.cells).T)] = True
    for color in _NAMED:
        i = COLORS.index(color)
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
            thing = _named_object(layers, rows[label == k], names[label == k] == i, names[label == k], color)
            if thing is not None and labeled[tuple(layers.cells_of(thing.cells).T)].mean() < _COVERED:
                found.append(thing)
    return sorted(found, key=lambda thing: -len(thing.cells))


def _labeled_objects(
    layers: Layers, rows: NDArray[np.int64], colors: NDArray[np.int64], known: Sequence[str]
) -> Iterator[FloorObject]:
    """Yields the connected parts of the voxels `rows` (n,) with one label. `colors` (n,) are their color names."""
    import cv2

    labels = labels_of_voxels(layers)[rows]
    cells = layers.voxels[rows, 1], layers.voxels[rows, 0]
    for number, name in enumerate(known, 1):
        mine = labels == number
        if not mine.any():
            continue
        mask = np.zeros(layers.shape, np.uint8)
        mask[cells[0][mine], cells[1][mine]] = 1
        closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        count, parts, sizes, _ = cv2.connectedComponentsWithStats(closed, connectivity=4)
        part = np.where(mine, parts[cells], 0)
        for k in range(1, count):
            if _LEAST_OF_A_FRONT <= sizes[k, cv2.CC_STAT_AREA] <= _MOST_CELLS:
                thing = _labeled_object(layers, rows[part == k], colors[part == k], name)
                if thing is not None:
                    yield thing


def _labeled_object(
    layers: Layers, rows: NDArray[np.int64], colors: NDArray[np.int64], name: str
) -> FloorObject | None:
    """Returns the object made of the voxels `rows`, or None if it hangs, has no likely size, or is not seen by most
    views."""
    import cv2

    cells = np.unique(layers.voxels[rows, :2], axis=0)
    (_, sides, _) = cv2.minAreaRect(cells.astype(np.float32))
    longer, shorter = (max(sides) + 1) * CELL, (min(sides) + 1) * CELL
    heights, points = layers.height_above_floor[rows], layers.places_of(rows)
    if heights.min() > _HANGS or not _SHORTEST <= longer <= _LONGEST or not _is_firm(layers, points):
        return None
    counts = np.bincount(colors[colors >= 0], minlength=len(COLORS))
    color = COLORS[int(counts.argmax())]
    is_clear = color in _NAMED and counts.max() >= _ONE_COLOR * len(colors)
    middles = layers.centers_of(cells[:, ::-1])
    return FloorObject(
        color if is_clear else "", name, middles, points, float(np.quantile(heights, 0.95)), (longer, shorter)
    )


def _stands_alone(mine: NDArray[np.bool_], taken: NDArray[np.uint8]) -> bool:
    """Whether the cells around an object are mostly free or walls."""
    import cv2

    around = cv2.dilate(mine.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool) & ~mine
    return float(taken[around].mean()) <= _ALONE


def _smooth_names(layers: Layers, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns (n,) color names of voxels, averaged with their neighbors because of wood grain and books in shelves."""
    from scipy.spatial import cKDTree

    lab = lab_of(layers.colors[rows])
    tree = cKDTree(layers.voxels[rows].astype(np.float32))
    _, near = tree.query(layers.voxels[rows].astype(np.float32), k=min(12, len(rows)), distance_upper_bound=3.0)
    padded = np.concatenate([lab, np.zeros((1, 3), np.float32)])
    weight = (near < len(rows)).astype(np.float32)
    mean = (padded[near] * weight[..., None]).sum(axis=1) / weight.sum(axis=1)[:, None]
    return names_of(mean)


def _named_object(
    layers: Layers, rows: NDArray[np.int64], of_color: NDArray[np.bool_], names: NDArray[np.int64], color: str
) -> FloorObject | None:
    """Returns the object made of the voxels `rows`, or None if it cannot be named reliably."""
    import cv2

    voxels = layers.voxels[rows]
    cells, back = np.unique(voxels[:, :2], axis=0, return_inverse=True)
    back = back.reshape(-1)
    if of_color.mean() < _LEAST_OF_ITS_COLOR:
        return None
    many = of_color.mean() < 0.4 or of_color.sum() < _ONE_COLOR * max(1, (names != NAMELESS).sum())
    (_, sides, _) = cv2.minAreaRect(cells.astype(np.float32))
    longer, shorter = (max(sides) + 1) * CELL, (min(sides) + 1) * CELL
    heights = layers.height_above_floor[rows]
    tops = np.zeros(len(cells))
    np.maximum.at(tops, back, heights)
    top = float(np.quantile(tops, 0.9))
    front = top >= _FRONT and len(rows) * CELL >= _WHOLE * len(cells) * (top - _FROM)
    if not _SHORTEST <= longer <= _LONGEST or not front and (shorter < _THINNEST or len(cells) < _LEAST_CELLS):
        return None
    lowest = np.full(len(cells), np.inf)
    np.minimum.at(lowest, back, heights)
    between = (heights > _FROM + 0.05) & (heights < top - 0.15)
    spread = float(lab_of(layers.colors[rows[between]])[:, 2].std()) if between.any() else 0.0
    begins = float(np.quantile(heights[of_color], 0.03))
    own_share = float(of_color.mean())
    shape = shape_of(Outline(cells, tops, lowest, top, longer, shorter, front, color, own_share, begins, spread))
    if shape is None or many and shape != "bookshelf":
        return None
    points = layers.places_of(rows[of_color])
    own = np.zeros(len(cells))
    np.maximum.at(own, back[of_color], heights[of_color])
    if (own[own > 0] > top - _NEAR_TOP).mean() < _AT_TOP:
        return None  # the top is another object, or an artifact above this one
    if not _is_firm(layers, points):
        return None
    return FloorObject(color, shape, layers.centers_of(cells[:, ::-1]), points, top, (longer, shorter))


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
