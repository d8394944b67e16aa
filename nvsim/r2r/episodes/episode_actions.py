"""Computes the actions that move a robot along a path in free space: 0.25 m forward, 15 degrees left or right, stop.

Free space is the visible floor of a storey near graph edges, without obstacles.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import NavGraph
from nvsim.r2r.surroundings.layers import CELL, FLOOR, Layers

RADIUS = 0.25
"""Radius of the robot in meters."""
_MARGIN = 0.07  # extra meters, because the observed surfaces are not exact
_FROM, _TO = 0.1, 1.7  # meters above the floor; surfaces between these heights are obstacles
_LEAST = 2  # smallest number of voxels in a column that make an obstacle
_SPECK = 4  # smallest number of connected cells of a point cloud that make an obstacle
_FROM_EDGES = 0.45  # meters; the floor is not verified farther from the edges
_EASY = 0.6  # meters from the robot's center to obstacles; a larger distance does not make a path cheaper
STOP, FORWARD, LEFT, RIGHT = 0, 1, 2, 3
STEP, TURN = 0.25, 15
"""Meters and degrees of one action."""
_REACH = 0.8  # largest distance from the path, in meters
_ARRIVED = 0.3  # largest distance from the goal at the end, in meters
_CELL, _GREED = 0.1, 1.3
_MOST = 60_000  # largest number of expanded states
_CHECKED = 0.05  # meters between the positions that are checked along one forward step


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """Free space of one storey as a grid.

    room     (rows, columns) meters to the nearest obstacle or unseen floor, minus the robot's radius and margin
    layers   the layers of the storey
    """

    room: NDArray[np.float32]
    layers: Layers

    @staticmethod
    def of(layers: Layers, graph: NavGraph, cloud: NDArray[np.floating] | None = None) -> FreeSpace:
        """Computes the free space of a storey.

        `cloud` (N, 3), meters, world, adds known surfaces, for example from a LiDAR scan.
        """
        from scipy.ndimage import distance_transform_edt

        free = visible_floor(layers)
        free &= layers.count_per_cell(layers.is_confirmed(_FROM, _TO)) < _LEAST
        if cloud is not None:
            free &= ~scanned_obstacles(layers, cloud)
        meters = (distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] - 0.5) * CELL
        meters[_far_from_edges(layers, graph)] = 0.0
        return FreeSpace((meters - (RADIUS + _MARGIN)).astype(np.float32), layers)

    def is_free(self, places: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Returns (...) whether the robot is in free space at world x, y (..., 2 or more), meters."""
        return np.asarray(self.layers.values_at(self.room, places) >= 0)

    def to_go(self, path: NDArray[np.floating], reach: float) -> NDArray[np.float32]:
        """Returns (rows, columns) the robot's distance in meters to the end of a path (N, 2 or more), meters, world.

        The robot stays within `reach` meters of the path. Distances near obstacles count more. Cells that the robot
        cannot reach are infinite.
        """
        from scipy.ndimage import distance_transform_edt

        from nvsim.occupancy.grid_ways import GridWays

        near = distance_transform_edt(~self._cells_of_path(path)) * CELL <= reach
        open_cells = near & (self.room >= 0)
        row, column = self.layers.cells_of(path[-1])
        if not open_cells[row, column]:
            return np.full(self.room.shape, np.inf, np.float32)
        cost_factors = 1 + np.clip(1 - (self.room + RADIUS) / _EASY, 0, 1)
        return GridWays(open_cells, CELL, (int(row), int(column)), cost_factors=cost_factors).meters.astype(np.float32)

    def joins(self, a: NDArray[np.floating], b: NDArray[np.floating]) -> bool:
        """Returns True if the robot can move from `a` to `b`, places (2,) or (3,), meters, world.

        It comes within 0.3 m of both, and stays within 0.8 m of the line between them.
        """
        import cv2

        ends = np.array([a[:2], b[:2]], np.float64)
        margin = math.ceil(_REACH / CELL)
        cells = self.layers.cells_of(ends)
        top, left = np.maximum(cells.min(axis=0) - margin, 0)
        bottom, right = cells.max(axis=0) + margin + 1
        room = self.room[top:bottom, left:right]
        if not room.size:
            return False
        rows, columns = np.indices(room.shape)
        places = self.layers.centers_of(np.stack([rows + top, columns + left], axis=-1))
        along = ends[1] - ends[0]
        share = ((places - ends[0]) @ along / max(float(along @ along), 1e-12)).clip(0, 1)
        near = np.linalg.norm(ends[0] + share[..., None] * along - places, axis=-1) <= _REACH
        _, parts = cv2.connectedComponents(((room >= 0) & near).astype(np.uint8), connectivity=4)
        at = [set(parts[np.linalg.norm(places - end, axis=-1) <= _ARRIVED].tolist()) - {0} for end in ends]
        return bool(at[0] & at[1])

    def _cells_of_path(self, path: NDArray[np.floating]) -> NDArray[np.bool_]:
        return _lines(self.layers, list(zip(path[:-1, :2], path[1:, :2])))


def visible_floor(layers: Layers) -> NDArray[np.bool_]:
    """Returns (rows, columns) the cells with visible floor."""
    return _fill_single_holes(layers.count_between(-FLOOR - CELL / 2, FLOOR + CELL / 2) > 0)


def scanned_obstacles(layers: Layers, cloud: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Returns (rows, columns) the cells in which a point cloud has obstacles, without specks."""
    import cv2

    above = cloud[:, 2] - layers.floor
    cells = layers.cells_of(cloud[(above > _FROM) & (above < _TO), :2])
    cells = cells[((cells >= 0) & (cells < layers.shape)).all(axis=1)]
    mask = np.zeros(layers.shape, np.uint8)
    mask[cells[:, 0], cells[:, 1]] = 1
    _, labels, sizes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    large = sizes[:, cv2.CC_STAT_AREA] >= _SPECK
    large[0] = False
    return np.asarray(large[labels])


def _fill_single_holes(floor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Fills holes of single cells, which occur far from all viewpoints because rays are sparse there."""
    import cv2

    return cv2.morphologyEx(floor.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)).astype(bool)


def _far_from_edges(layers: Layers, graph: NavGraph) -> NDArray[np.bool_]:
    from scipy.ndimage import distance_transform_edt

    at = {one.viewpoint.id: np.array(one.viewpoint.position[:2]) for one in layers.seen}
    ends = [(at[a], at[b]) for a, b in graph.edges if a in at and b in at]
    return np.asarray(distance_transform_edt(~_lines(layers, ends)) * CELL > _FROM_EDGES)


def _lines(layers: Layers, ends: list[tuple[NDArray[np.floating], NDArray[np.floating]]]) -> NDArray[np.bool_]:
    """Returns (rows, columns) the cells on straight lines."""
    mask = np.zeros(layers.shape, bool)
    for a, b in ends:
        count = int(np.linalg.norm(b - a) / (CELL / 2)) + 2
        cells = layers.cells_of(a + np.linspace(0, 1, count)[:, None] * (b - a))
        inside = ((cells >= 0) & (cells < layers.shape)).all(axis=1)
        mask[cells[inside, 0], cells[inside, 1]] = True
    return mask


@dataclass(frozen=True, eq=False)
class ActionPath:
    """The actions along a path and the poses before them.

    actions   from the start; the last one is STOP
    places    (N, 2) meters, world x and y before each action
    headings  (N,) radians before each action; 0 is +y, positive turns right
    """

    actions: tuple[int, ...]
    places: NDArray[np.float64]
    headings: NDArray[np.float64]


def walk_along(space: FreeSpace, path: NDArray[np.floating], heading: float, turn: int = TURN) -> ActionPath | None:
    """Finds a nearly minimal sequence of collision-free actions along a path.

    The robot starts at the first point of `path` (M, 2 or more), meters, world, with heading `heading` (radians). It
    turns by `turn` degrees, a divisor of 360, stays close to the path, and ends near the last point. Returns None if no
    such sequence is found.

    Method: A* over positions in 10 cm cells and the headings that turns reach (Dolgov et al. 2008, hybrid A*).
    """
    to_go = space.to_go(path, _REACH)
    start, goal = (float(path[0, 0]), float(path[0, 1])), np.asarray(path[-1, :2], np.float64)
    left = _distance_left(space, to_go, start)
    if not math.isfinite(left):
        return None
    ways = [(math.sin(h), math.cos(h)) for h in (heading + math.radians(turn * k) for k in range(360 // turn))]
    order = count()
    # (estimated actions, order, actions so far, x, y, turns to the right, previous state, action)
    waiting = [(_GREED * left / STEP, next(order), 0, *start, 0, -1, -1)]
    done: set[tuple[int, int, int]] = set()
    closed: list[tuple[float, float, int, int, int]] = []
    while waiting and len(closed) < _MOST:
        _, _, actions, x, y, k, before, action = heapq.heappop(waiting)
        key = (round(x / _CELL), round(y / _CELL), k)
        if key in done:
            continue
        done.add(key)
        here = len(closed)
        closed.append((x, y, k, before, action))
        if math.hypot(x - goal[0], y - goal[1]) <= _ARRIVED and _distance_left(space, to_go, (x, y)) < 2 * _ARRIVED:
            return _path_from_search(closed, heading, turn)
        turns = 360 // turn
        nexts = [(x, y, (k - 1) % turns, LEFT), (x, y, (k + 1) % turns, RIGHT)]
        ahead = x + STEP * ways[k][0], y + STEP * ways[k][1]
        if _is_free(space, (x, y), ahead):
            nexts.insert(0, (*ahead, k, FORWARD))
        for x1, y1, k1, how in nexts:
            left = _distance_left(space, to_go, (x1, y1))
            if math.isfinite(left) and (round(x1 / _CELL), round(y1 / _CELL), k1) not in done:
                cost = actions + 1 + _GREED * left / STEP
                heapq.heappush(waiting, (cost, next(order), actions + 1, x1, y1, k1, here, how))
    return None


def _distance_left(space: FreeSpace, to_go: NDArray[np.float32], place: tuple[float, float]) -> float:
    layers = space.layers
    column, row = (math.floor((v - low) / CELL) for v, low in zip(place, layers.low))
    inside = 0 <= row < layers.shape[0] and 0 <= column < layers.shape[1]
    return float(to_go[row, column]) if inside else math.inf


def _is_free(space: FreeSpace, a: tuple[float, float], b: tuple[float, float]) -> bool:
    shares = np.arange(1, round(STEP / _CHECKED) + 1)[:, None] * (_CHECKED / STEP)
    return bool(space.is_free(np.array(a) + shares * (np.array(b) - np.array(a))).all())


def _path_from_search(closed: list[tuple[float, float, int, int, int]], heading: float, turn: int) -> ActionPath:
    chain = [len(closed) - 1]
    while closed[chain[-1]][3] >= 0:
        chain.append(closed[chain[-1]][3])
    states = [closed[i] for i in reversed(chain)]
    actions = (*(state[4] for state in states[1:]), STOP)
    places = np.array([state[:2] for state in states], np.float64)
    turns = heading + np.radians(turn) * np.array([state[2] for state in states])
    return ActionPath(actions, places, np.asarray(turns % (2 * math.pi)))
