"""Find paths over known floor for which the graph makes a detour, and add the viewpoints that they need.

The paths are wide enough for the robot. They show where a graph could lead before anything is rendered.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Viewpoint
from nvsim.kernel_threads import allowed_threads
from nvsim.mapping.criteria import can_stand
from nvsim.mapping.search.survey import Survey
from nvsim.mapping.search.trajectory import Walk
from nvsim.mapping.settling.draft_graph import DraftGraph
from nvsim.occupancy.grid_ways import Cell, GridWays

_CELL = 0.1  # meters
_EASY = 0.6  # meters of room beside a path; more room is no advantage
_TIGHT = 2.0  # extra length of a path without any room, as a multiple of its length
_STOREY = 1.5  # minimum meters between cameras of two storeys


class WideKnownFloor:
    """Floor with at least `half_width` meters of known floor around it, at a resolution of 10 cm, without the areas
    that were closed."""

    def __init__(self, walk: Walk, half_width: float) -> None:
        self._walk, self.least = walk, half_width - _CELL / 2
        self._shut = np.zeros((0, 4))  # x, y, z, radius of closed areas, meters

    def close_floor(self, place: NDArray[np.floating], radius: float) -> None:
        """Close the floor within `radius` meters of a position (3,)."""
        self._shut = np.vstack([self._shut, [*place, radius]])

    @property
    def closed_count(self) -> int:
        """Number of closed areas."""
        return len(self._shut)

    def is_affected_since(self, before: int, place: NDArray[np.floating], reach: float) -> bool:
        """Whether areas that were closed since `closed_count` was `before` can affect `lengths` from a position (3,)
        over at most `reach` meters."""
        window = np.full(2, reach + _CELL)
        return len(self._shut_in(place[:2] - window, place[:2] + window, float(place[2]), before)) > 0

    def lengths(self, start: NDArray[np.floating], ends: NDArray[np.floating], reach: float) -> NDArray[np.float64]:
        """Return (N,) meters of the paths from one camera (3,) to others (N, 3). Infinite if there is no path of at
        most `reach` meters."""
        window = _CameraWindow(start, reach, self)
        cells = window.cells_of(ends)
        ways = window.find_paths(cells[cells[:, 0] >= 0], reach=reach)
        found = np.where(cells[:, 0] >= 0, ways.meters[cells[:, 0], cells[:, 1]], np.inf)
        return np.asarray(np.maximum(found, np.linalg.norm(ends[:, :2] - start[:2], axis=1)))

    def find_path(self, start: NDArray[np.floating], end: NDArray[np.floating], reach: float) -> NDArray[np.float64]:
        """Return (K, 3) positions, meters, of a path from one camera (3,) to another within `reach` meters, at the
        height of the first. The path prefers the middle of the room to the shortest line. Empty if there is no path."""
        window = _CameraWindow(start, reach, self)
        last = window.cells_of(np.asarray(end)[None])
        ways = window.find_paths(last, _TIGHT)
        if last[0, 0] < 0 or not np.isfinite(ways.meters[last[0, 0], last[0, 1]]):
            return np.zeros((0, 3))
        return window.places(ways.cells_to((int(last[0, 0]), int(last[0, 1]))))

    def clearance(self, places: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return (N,) meters from positions (N, 3) to the nearest unknown floor; 0 in closed areas."""
        found = self._walk.clearance_at(places)
        if len(places):
            low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
            for x, y, _, radius in self._shut_in(low, high, float(places[0, 2])):
                found[np.hypot(places[:, 0] - x, places[:, 1] - y) < radius] = 0.0
        return found

    def clearance_over(self, x: NDArray[np.float64], y: NDArray[np.float64], z: float) -> NDArray[np.float64]:
        """Return (rows, columns) clearances in meters for all positions with a coordinate of `y` (rows,) and of `x`
        (columns,), ascending, at the height z."""
        found = self._walk.clearance_over(x, y, z)
        for at_x, at_y, _, radius in self._shut_in(np.array([x[0], y[0]]), np.array([x[-1], y[-1]]), z):
            columns = slice(*np.searchsorted(x, [at_x - radius, at_x + radius]))
            rows = slice(*np.searchsorted(y, [at_y - radius, at_y + radius]))
            found[rows, columns][np.hypot(x[columns] - at_x, y[rows, None] - at_y) < radius] = 0.0
        return found

    def _shut_in(
        self, low: NDArray[np.floating], high: NDArray[np.floating], z: float, since: int = 0
    ) -> NDArray[np.float64]:
        """(K, 4) closed areas that reach into the box from `low` to `high` (2,) on the storey of a camera at z."""
        shut = self._shut[since:]
        x, y, at_z, radius = shut.T
        across = (x > low[0] - radius) & (x < high[0] + radius)
        along = (y > low[1] - radius) & (y < high[1] + radius)
        return shut[across & along & (np.abs(at_z - z) < _STOREY)]

    def is_wide(self, places: NDArray[np.floating], spare: float | NDArray[np.floating] = 0.0) -> NDArray[np.bool_]:
        """Return (N,) bool: whether the robot has room at positions (N, 3), with `spare` (N,) meters of extra room."""
        return self.clearance(places) >= self.least + spare


class _CameraWindow:
    """The cells within `reach` of a camera (3,), and which of them have room."""

    def __init__(self, camera: NDArray[np.floating], reach: float, floor: WideKnownFloor) -> None:
        half = int(np.ceil(reach / _CELL))
        self._side, self._camera = 2 * half + 1, np.asarray(camera, np.float64)
        self._start: Cell = half, half
        self._low = self._camera[:2] - (half + 0.5) * _CELL
        along = (np.arange(self._side) + 0.5) * _CELL
        self._x, self._y = self._low[0] + along, self._low[1] + along
        self._clearance = floor.clearance_over(self._x, self._y, float(self._camera[2]))
        self._room = self._clearance >= floor.least

    def cells_of(self, places: NDArray[np.floating]) -> NDArray[np.int64]:
        """(N, 2) row and column of positions (N, 3) on the camera's storey; -1 if they are not in a cell with room."""
        column, row = np.floor((places[:, :2] - self._low) / _CELL).astype(np.int64).T
        inside = (row >= 0) & (column >= 0) & (row < self._side) & (column < self._side)
        inside &= np.abs(places[:, 2] - self._camera[2]) < _STOREY
        at = np.stack([row, column], axis=1)
        here = (at == self._start).all(axis=1)
        inside[inside] &= self._room[row[inside], column[inside]] | here[inside]
        at[~inside] = -1
        return at

    def places(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """(N, 3) centers of cells (N, 2) at the camera's height."""
        return np.column_stack([self._x[cells[:, 1]], self._y[cells[:, 0]], np.full(len(cells), self._camera[2])])

    def find_paths(self, ends: NDArray[np.int64], tight: float = 0.0, reach: float = math.inf) -> GridWays:
        """Return the paths to cells (N, 2). Where room is scarce, each step counts as longer, by up to `tight` times
        its length."""
        cost_factors = 1 + tight * np.clip(1 - self._clearance / _EASY, 0, 1) if tight else None
        return GridWays(self._room, _CELL, self._start, cost_factors=cost_factors, ends=ends, reach=reach)


_REACH = 6.0  # maximum meters of the paths that are examined
_DETOUR = 1.3  # maximum ratio of a path in the graph to the path over known floor
_LOSS = 0.75  # meters that it may be longer in any case
_GAIN = 0.25  # minimum meters by which new viewpoints must shorten the path
_BETWEEN = 3  # maximum viewpoints on a path
_BEFORE = 0.8  # meters before the end of a leg within which it may end instead, at a position with more room
_TIP = 0.5  # meters at both ends of a path in which its legs need no extra room
_APART = 0.3  # meters between two positions of a path, if possible
_THERE = 0.5  # meters: a viewpoint this close is used for a position
_SHUT = 0.3  # meters around the narrowest position of a corridor that was not free, which are closed
_ROUNDS = 3
_SPACING = 0.05  # meters between the examined positions of a leg
_EXTRA = (0.2, 0.1, 0.0)  # meters of extra room beside the legs, in the order in which they are tried

Join = Callable[[list[str]], None]
IsOpen = Callable[[Viewpoint, Viewpoint], bool]


class Shortcuts:
    """Finds shortcuts in the graph of `survey`, whose viewpoints and edges are `ways`."""

    def __init__(self, survey: Survey, ways: DraftGraph, is_open: IsOpen, join: Join) -> None:
        self._survey, self._draft, self._ways = survey, survey.draft, ways
        self._is_open, self._join = is_open, join
        self._room = WideKnownFloor(survey.walk, survey.config.half_width)
        # _known: id -> id -> (meters over known floor, number of closed areas at that time). _hopeless: pairs without
        # stops -> number of closed areas at that time.
        self._known: dict[str, dict[str, tuple[float, int]]] = {}
        self._hopeless: dict[tuple[str, str], int] = {}

    def make(self) -> Iterator[None]:
        """Shorten the detours between pairs of viewpoints, one after the other, the nearest first. Yields before each
        pair."""
        for _ in range(_ROUNDS):
            before = list(self._ways)
            for meters, a, b in self._detours():
                yield
                if self._is_detour(a, b, meters):
                    self._shorten(a, b)
            if list(self._ways) == before:
                return

    def _detours(self) -> list[tuple[float, str, str]]:
        """Return the meters over known floor and the ends, the shortest first."""
        ids, looks = sorted(self._ways), list[tuple[str, list[str]]]()
        places = np.array([self._draft.viewpoints[id].position for id in ids])
        for i, id in enumerate(ids[:-1]):
            others = i + 1 + np.flatnonzero(np.hypot(*(places[i + 1 :, :2] - places[i, :2]).T) < _REACH)
            along = self._ways.path_lengths_from(id, _detour_limit(_REACH))
            apart = np.linalg.norm(places[others, :2] - places[i, :2], axis=1)
            # No path is shorter than the straight line, so most pairs are settled without a search over the floor.
            # Paths never become shorter: if one was too long for a detour before an area was closed, it still is.
            known, far = self._known.setdefault(id, {}), []
            for j, meters in zip(others, apart, strict=True):
                least = max(meters, known.get(ids[j], (0.0, 0))[0])
                if math.isfinite(least) and along.get(ids[j], math.inf) > _detour_limit(least):
                    far.append(ids[j])
            if far:
                looks.append((id, far))
        # In parallel: each is a search over floor in a kernel, and no area is closed meanwhile.
        with ThreadPoolExecutor(allowed_threads(), "shortcuts") as pool:
            for _ in pool.map(self._measure_paths, *zip(*looks, strict=True)) if looks else ():
                pass
        pairs = [(round(self._known[id][other][0], 3), id, other) for id, far in looks for other in far]
        return sorted(pair for pair in pairs if self._is_detour(pair[1], pair[2], pair[0]))

    def _measure_paths(self, id: str, others: Sequence[str]) -> None:
        """Compute the lengths of paths over known floor from a viewpoint to others, if they are unknown or an area near
        it was closed since."""
        known, here = self._known[id], np.array(self._draft.viewpoints[id].position)
        since = {
            shuts: self._room.is_affected_since(shuts, here, _REACH) for shuts in {shuts for _, shuts in known.values()}
        }
        new = [other for other in others if other not in known or since[known[other][1]]]
        if new:
            places = np.array([self._draft.viewpoints[other].position for other in new])
            lengths = self._room.lengths(here, places, _REACH).tolist()
            known.update({other: (meters, self._room.closed_count) for other, meters in zip(new, lengths, strict=True)})

    def _is_detour(self, a: str, b: str, meters: float) -> bool:
        if np.isinf(meters) or a not in self._ways or b not in self._ways:
            return False
        return self._ways.meters(a, b, _detour_limit(meters)) > _detour_limit(meters)

    def _shorten(self, a: str, b: str) -> None:
        """Put viewpoints on the path over known floor, and join them if its legs are free: first on legs with extra
        room, because the corridor of a leg ends where an obstacle begins, then on all wide legs."""
        for spare in _EXTRA:
            if self._shorten_with_room(a, b, spare):
                return

    def _shorten_with_room(self, a: str, b: str, spare: float) -> bool:
        """Return whether viewpoints on legs with `spare` meters of extra room shorten the path of the graph. Otherwise
        they are removed again."""
        ends = self._draft.viewpoints[a], self._draft.viewpoints[b]
        was = self._ways.meters(a, b)
        stops = self._plan_stops(*ends, spare)
        here, new = ends[0], list[str]()
        for place in [*stops, None] if stops else []:
            viewpoint = ends[1] if place is None else self._viewpoint_at(place)
            if viewpoint is None:
                if not spare:
                    self._room.close_floor(np.array(place), _SHUT)
                break
            if viewpoint.id not in self._ways and viewpoint.id not in new:
                new.append(viewpoint.id)
            if viewpoint.id != here.id and not self._is_open(here, viewpoint):
                if not spare:
                    self._close_narrowest(here, viewpoint)
                break
            here = viewpoint
        else:
            if new:
                self._join(new)
            now = self._ways.meters(a, b, was)
            if math.isfinite(now) and now <= was - _GAIN:
                return True
        for id in new:
            if id in self._ways:
                self._ways.remove(id)
            self._draft.remove(id)
        return False

    def _plan_stops(self, start: Viewpoint, end: Viewpoint, spare: float) -> list[NDArray[np.float64]]:
        """Return positions between two cameras that straight legs with `spare` meters of extra room connect. Empty if
        there is no such path, if no position is needed, or if too many are."""
        pair, here = (start.id, end.id), np.array(start.position)
        if pair in self._hopeless and not self._room.is_affected_since(self._hopeless[pair], here, _REACH):
            return []
        found = self._places(here, np.array(end.position), spare)
        if not found and not spare:
            self._hopeless[pair] = self._room.closed_count
        return found

    def _places(self, start: NDArray[np.float64], end: NDArray[np.float64], spare: float) -> list[NDArray[np.float64]]:
        way = self._room.find_path(start, end, _REACH)
        if not len(way):
            return []
        way = np.concatenate([way, end[None]])
        stops: list[NDArray[np.float64]] = []
        at = 0
        while len(stops) <= _BETWEEN:
            ahead = at + 1 + np.flatnonzero(self._are_legs(way[at], way[at + 1 :], spare, way[[0, -1]]))
            if not len(ahead):
                return []
            here, at = way[at], int(ahead[-1])
            if at == len(way) - 1:
                return stops
            late = ahead[np.hypot(*(way[ahead] - way[at])[:, :2].T) <= _BEFORE]
            apart = late[np.hypot(*(way[late] - here)[:, :2].T) >= _APART]
            late = apart if len(apart) else late
            at = int(late[np.argmax(np.round(self._room.clearance(way[late]), 2))])
            stops.append(way[at])
        return []

    def _are_legs(
        self, start: NDArray[np.float64], ends: NDArray[np.float64], spare: float, tips: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """(N,) bool: whether straight legs with `spare` meters of extra room lead from a position (3,) to others
        (N, 3). Near the ends of the path, `tips` (2, 3), no extra room is needed, because viewpoints are there."""
        found = np.hypot(*(ends - start)[:, :2].T) <= self._survey.config.reach
        near = np.flatnonzero(found)
        legs = [_points_between(start, ends[k])[1:-1] for k in near]
        if legs:
            places = np.concatenate(legs)
            inner = np.linalg.norm(places[:, None, :2] - tips[:, :2], axis=2).min(axis=1) >= _TIP
            wide = self._room.is_wide(places, np.where(inner, spare, 0.0))
            first = np.cumsum([0, *map(len, legs[:-1])])
            found[near] = np.logical_and.reduceat(wide, first)
        return found

    def _viewpoint_at(self, place: NDArray[np.float64]) -> Viewpoint | None:
        """Return the viewpoint at a position, or one near enough; None if there is no room for one."""
        place = np.array([*place[:2], self._survey.walk.height(place)])
        near = [v for v in self._draft.viewpoints_near(place, _THERE) if v.id in self._ways]
        if near:
            return near[0]
        if not self._survey.is_level(place):
            return None
        viewpoint = self._survey.viewpoint(place, "step")
        self._survey.lattice.begin(viewpoint.id, viewpoint.position[:2])
        around = self._survey.around(viewpoint)
        if not can_stand(around, self._survey.config):
            return None
        self._survey.add_viewpoint(viewpoint, around)
        return self._draft.viewpoints[viewpoint.id]

    def _close_narrowest(self, a: Viewpoint, b: Viewpoint) -> None:
        leg = _points_between(np.array(a.position), np.array(b.position))
        inner = leg[len(leg) // 5 : -(len(leg) // 5) or None]
        self._room.close_floor(inner[int(np.argmin(self._room.clearance(inner)))], _SHUT)


def _detour_limit(meters: float) -> float:
    """Return the meters above which a path of the graph is a detour."""
    return max(_DETOUR * meters, meters + _LOSS)


def _points_between(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 3) positions from a to b."""
    count = max(4, int(np.ceil(np.hypot(*(b - a)[:2]) / _SPACING)) + 1)
    return np.asarray(a + np.linspace(0, 1, count)[:, None] * (b - a))
