"""Computes the actions that move a robot along a path: 0.25 m forward, 15 degrees left or right, and stop."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.episodes.free_space import FreeSpace
from nvsim.r2r.surroundings.layers import CELL

STOP, FORWARD, LEFT, RIGHT = 0, 1, 2, 3
STEP, TURN = 0.25, 15
"""Meters and degrees of one action."""
_REACH = 0.8  # largest distance from the path, in meters
_ARRIVED = 0.3  # largest distance from the goal at the end, in meters
_CELL, _GREED = 0.1, 1.3
_MOST = 60_000  # largest number of expanded states
_CHECKED = 0.05  # meters between the positions that are checked along one forward step


@dataclass(frozen=True, eq=False)
class Walk:
    """The actions along a path and the poses before them.

    actions   from the start; the last one is STOP
    places    (N, 2) meters, world x and y before each action
    headings  (N,) radians before each action; 0 is +y, positive turns right
    """

    actions: tuple[int, ...]
    places: NDArray[np.float64]
    headings: NDArray[np.float64]


def walk_along(space: FreeSpace, path: NDArray[np.floating], heading: float) -> Walk | None:
    """Finds a nearly minimal sequence of collision-free actions along a path.

    The robot starts at the first point of `path` (M, 2 or more), meters, world, with heading `heading` (radians). It
    stays close to the path and ends near the last point. Returns None if no such sequence is found.

    Method: A* over positions in 10 cm cells and the headings that turns reach (Dolgov et al. 2008, hybrid A*).
    """
    to_go = space.to_go(path, _REACH)
    start, goal = (float(path[0, 0]), float(path[0, 1])), np.asarray(path[-1, :2], np.float64)
    left = _left(space, to_go, start)
    if not math.isfinite(left):
        return None
    ways = [(math.sin(h), math.cos(h)) for h in (heading + math.radians(TURN * k) for k in range(360 // TURN))]
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
        if math.hypot(x - goal[0], y - goal[1]) <= _ARRIVED and _left(space, to_go, (x, y)) < 2 * _ARRIVED:
            return _back(closed, heading)
        turns = 360 // TURN
        nexts = [(x, y, (k - 1) % turns, LEFT), (x, y, (k + 1) % turns, RIGHT)]
        ahead = x + STEP * ways[k][0], y + STEP * ways[k][1]
        if _is_free(space, (x, y), ahead):
            nexts.insert(0, (*ahead, k, FORWARD))
        for x1, y1, k1, how in nexts:
            left = _left(space, to_go, (x1, y1))
            if math.isfinite(left) and (round(x1 / _CELL), round(y1 / _CELL), k1) not in done:
                cost = actions + 1 + _GREED * left / STEP
                heapq.heappush(waiting, (cost, next(order), actions + 1, x1, y1, k1, here, how))
    return None


def _left(space: FreeSpace, to_go: NDArray[np.float32], place: tuple[float, float]) -> float:
    layers = space.layers
    column, row = (math.floor((v - low) / CELL) for v, low in zip(place, layers.low))
    inside = 0 <= row < layers.shape[0] and 0 <= column < layers.shape[1]
    return float(to_go[row, column]) if inside else math.inf


def _is_free(space: FreeSpace, a: tuple[float, float], b: tuple[float, float]) -> bool:
    shares = np.arange(1, round(STEP / _CHECKED) + 1)[:, None] * (_CHECKED / STEP)
    return bool(space.is_free(np.array(a) + shares * (np.array(b) - np.array(a))).all())


def _back(closed: list[tuple[float, float, int, int, int]], heading: float) -> Walk:
    chain = [len(closed) - 1]
    while closed[chain[-1]][3] >= 0:
        chain.append(closed[chain[-1]][3])
    states = [closed[i] for i in reversed(chain)]
    actions = (*(state[4] for state in states[1:]), STOP)
    places = np.array([state[:2] for state in states], np.float64)
    turns = heading + np.radians(TURN) * np.array([state[2] for state in states])
    return Walk(actions, places, np.asarray(turns % (2 * math.pi)))
