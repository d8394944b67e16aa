"""Ways over known floor that a graph leads around, and the viewpoints between that make them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Viewpoint
from nvsim.kernel_threads import allowed
from nvsim.mapping.criteria import can_stand
from nvsim.mapping.known_room import KnownRoom
from nvsim.mapping.survey import Survey
from nvsim.mapping.ways import Ways

_REACH = 6.0  # metres of the ways that are looked at
_DETOUR = 1.3  # times as long as the way over known floor, one of the graph may be
_LOSS = 0.75  # metres that it may be longer in any case
_GAIN = 0.25  # metres that viewpoints must make the way shorter to stay
_BETWEEN = 3  # viewpoints on a way, at most
_BEFORE = 0.8  # metres before the end of a leg within which it may end instead, where there is more room
_THERE = 0.5  # metres from a place within which a viewpoint stands in for it
_SHUT = 0.3  # metres around the narrowest place of a corridor that did not pass, which are taken for closed
_ROUNDS = 3
_SPACING = 0.05  # metres between the places of a leg that are looked at

Join = Callable[[list[str]], None]
IsOpen = Callable[[Viewpoint, Viewpoint], bool]


class Shortcuts:
    """Looks for them in the graph of `survey`, whose viewpoints and edges are `ways`."""

    def __init__(self, survey: Survey, ways: Ways, is_open: IsOpen, join: Join) -> None:
        self._survey, self._draft, self._ways = survey, survey.draft, ways
        self._is_open, self._join = is_open, join
        self._room = KnownRoom(survey.walk, survey.config.half_width)
        # id -> id -> metres over known floor and how much was shut by then; of pairs without stops, how much was
        self._known: dict[str, dict[str, tuple[float, int]]] = {}
        self._hopeless: dict[tuple[str, str], int] = {}

    def make(self) -> Iterator[None]:
        """Takes one pair of viewpoints after the other that the graph leads a detour between, the nearest first."""
        for _ in range(_ROUNDS):
            before = list(self._ways)
            for metres, a, b in self._detours():
                yield
                if self._is_detour(a, b, metres):
                    self._shorten(a, b)
            if list(self._ways) == before:
                return

    def _detours(self) -> list[tuple[float, str, str]]:
        """Metres over known floor and the ends, the shortest first."""
        ids, looks = sorted(self._ways), list[tuple[str, list[str]]]()
        places = np.array([self._draft.viewpoints[id].position for id in ids])
        for i, id in enumerate(ids[:-1]):
            others = i + 1 + np.flatnonzero(np.hypot(*(places[i + 1 :, :2] - places[i, :2]).T) < _REACH)
            along = self._ways.all_metres(id, _most(_REACH))
            apart = np.linalg.norm(places[others, :2] - places[i, :2], axis=1)
            # A straight way is the shortest that can be: most pairs are settled without looking at the floor. And a way
            # never becomes shorter: where it was too long for a detour before something was shut, it still is.
            known, far = self._known.setdefault(id, {}), []
            for j, metres in zip(others, apart, strict=True):
                least = max(metres, known.get(ids[j], (0.0, 0))[0])
                if math.isfinite(least) and along.get(ids[j], math.inf) > _most(least):
                    far.append(ids[j])
            if far:
                looks.append((id, far))
        # Side by side: each is a search over floor in a kernel, and nothing is shut meanwhile.
        with ThreadPoolExecutor(allowed(), "shortcuts") as pool:
            for _ in pool.map(self._look, *zip(*looks, strict=True)) if looks else ():
                pass
        pairs = [(round(self._known[id][other][0], 3), id, other) for id, far in looks for other in far]
        return sorted(pair for pair in pairs if self._is_detour(pair[1], pair[2], pair[0]))

    def _look(self, id: str, others: Sequence[str]) -> None:
        """Finds the lengths of the ways over known floor from a viewpoint to others that are not known, or not since
        something was shut near it."""
        known, here = self._known[id], np.array(self._draft.viewpoints[id].position)
        since = {shuts: self._room.shut_since(shuts, here, _REACH) for shuts in {shuts for _, shuts in known.values()}}
        new = [other for other in others if other not in known or since[known[other][1]]]
        if new:
            places = np.array([self._draft.viewpoints[other].position for other in new])
            lengths = self._room.lengths(here, places, _REACH).tolist()
            known.update({other: (metres, self._room.shuts) for other, metres in zip(new, lengths, strict=True)})

    def _is_detour(self, a: str, b: str, metres: float) -> bool:
        if np.isinf(metres) or a not in self._ways or b not in self._ways:
            return False
        return self._ways.metres(a, b, _most(metres)) > _most(metres)

    def _shorten(self, a: str, b: str) -> None:
        """Puts viewpoints on the way over known floor and joins them, if its legs pass; they go again where that
        makes the graph's way hardly shorter."""
        ends = self._draft.viewpoints[a], self._draft.viewpoints[b]
        was = self._ways.metres(a, b)
        stops = self._stops(*ends)
        here, new = ends[0], list[str]()
        for place in [*stops, None] if stops else []:
            viewpoint = ends[1] if place is None else self._stand(place)
            if viewpoint is None:
                self._room.shut(np.array(place), _SHUT)
                break
            if viewpoint.id not in self._ways and viewpoint.id not in new:
                new.append(viewpoint.id)
            if viewpoint.id != here.id and not self._is_open(here, viewpoint):
                self._shut(here, viewpoint)
                break
            here = viewpoint
        else:
            if new:
                self._join(new)
            now = self._ways.metres(a, b, was)
            if math.isfinite(now) and now <= was - _GAIN:
                return
        for id in new:
            if id in self._ways:
                self._ways.remove(id)
            self._draft.remove(id)

    def _stops(self, start: Viewpoint, end: Viewpoint) -> list[NDArray[np.float64]]:
        """Places between two cameras that straight, wide legs join; none where there is no such way, none is needed, or
        too many are."""
        pair, here = (start.id, end.id), np.array(start.position)
        if pair in self._hopeless and not self._room.shut_since(self._hopeless[pair], here, _REACH):
            return []
        found = self._places(here, np.array(end.position))
        if not found:
            self._hopeless[pair] = self._room.shuts
        return found

    def _places(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        way = self._room.way(start, end, _REACH)
        if not len(way):
            return []
        way = np.concatenate([way, end[None]])
        stops: list[NDArray[np.float64]] = []
        at = 0
        while len(stops) <= _BETWEEN:
            ahead = at + 1 + np.flatnonzero(self._are_legs(way[at], way[at + 1 :]))
            if not len(ahead):
                return []
            at = int(ahead[-1])
            if at == len(way) - 1:
                return stops
            late = ahead[np.hypot(*(way[ahead] - way[at])[:, :2].T) <= _BEFORE]
            at = int(late[np.argmax(np.round(self._room.clearance(way[late]), 2))])
            stops.append(way[at])
        return []

    def _are_legs(self, start: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) whether straight legs lead from a place (3,) to others (N, 3)."""
        found = np.hypot(*(ends - start)[:, :2].T) <= self._survey.config.reach
        near = np.flatnonzero(found)
        legs = [_along(start, ends[k])[1:-1] for k in near]
        if legs:
            wide = self._room.is_wide(np.concatenate(legs))
            first = np.cumsum([0, *map(len, legs[:-1])])
            found[near] = np.logical_and.reduceat(wide, first)
        return found

    def _stand(self, place: NDArray[np.float64]) -> Viewpoint | None:
        """The viewpoint at a place, or one that is near enough; None where nobody can stand."""
        place = np.array([*place[:2], self._survey.walk.height(place)])
        near = [v for v in self._draft.near(place, _THERE) if v.id in self._ways]
        if near:
            return near[0]
        if not self._survey.is_level(place):
            return None
        viewpoint = self._survey.viewpoint(place, "step")
        self._survey.lattice.begin(viewpoint.id, viewpoint.position[:2])
        around = self._survey.around(viewpoint)
        if not can_stand(around, self._survey.config):
            return None
        self._survey.take(viewpoint, around)
        return self._draft.viewpoints[viewpoint.id]

    def _shut(self, a: Viewpoint, b: Viewpoint) -> None:
        leg = _along(np.array(a.position), np.array(b.position))
        inner = leg[len(leg) // 5 : -(len(leg) // 5) or None]
        self._room.shut(inner[int(np.argmin(self._room.clearance(inner)))], _SHUT)


def _most(metres: float) -> float:
    """Metres from which on a way of the graph is a detour."""
    return max(_DETOUR * metres, metres + _LOSS)


def _along(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 3) places from one to the other."""
    count = max(4, int(np.ceil(np.hypot(*(b - a)[:2]) / _SPACING)) + 1)
    return np.asarray(a + np.linspace(0, 1, count)[:, None] * (b - a))
