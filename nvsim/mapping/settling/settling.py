"""Settling: make one usable graph from the lattices of the search.

Searches from several starts leave overlapping lattices, with viewpoints one meter apart that no edge joins, and many
paths of equal length. Settling uses the criteria of the search and does the following:

- Thin: of viewpoints that are close and see each other, one stays.
- Join: near viewpoints get an edge if the corridor is free in both directions and the path in the graph is a detour (a
  greedy spanner, Althoefer et al. 1993, On Sparse Spanners of Weighted Graphs).
- Restore: viewpoints that were connected stay connected, without long detours.
- Fill: positions without a viewpoint nearby get one, at the end of a shorter step.
- Bridge: a position that sees two parts of the graph gets a viewpoint if edges from it join them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.graph.types import Viewpoint
from nvsim.mapping.criteria import OPEN, can_stand
from nvsim.mapping.search.graph_builder import SAME, SAME_FLOOR, STEEPEST, level_distance
from nvsim.mapping.search.survey import Survey
from nvsim.mapping.settling.draft_graph import DETOUR, NEAR, DraftGraph, remove_ties
from nvsim.mapping.settling.shortcuts import Shortcuts

_LINKS = 6  # maximum viewpoints, the nearest first, to which a new one is joined
_SPACING = 0.3  # meters between the positions that are tried
_NEAREST = 4  # number of nearest viewpoints that may cover a position, tested for all positions at once
_HALFWAY = 3  # maximum positions on the way to a position that no step reaches
_BRIDGES = 6  # maximum positions that are tried between two parts
_LOOKS = 16  # places on a line at which its room is measured


class GapFiller:
    """Finds positions that the graph of `survey` does not cover and that have room, and measures around them."""

    def __init__(self, survey: Survey) -> None:
        self._survey, self._draft, self._walk, self._config = survey, survey.draft, survey.walk, survey.config
        self._tried: set[str] = set()

    def fill_gaps(self) -> Iterator[tuple[Viewpoint, list[Viewpoint]]]:
        """Yield each new viewpoint with the viewpoints around it that it sees. It is already in the graph; the caller
        joins it or removes it.

        Positions on the trajectory come first, then known floor, beginning with the most room. Last come positions a
        shorter step away, on the way to those that no step reaches.
        """
        beside = self._walk.positions_beside(self._config.half_width, _SPACING)
        missed = []
        places = np.concatenate([self._walk.places, beside])
        for place in places[~self._are_covered(places)]:
            seen = self._visible_viewpoints(place)
            if seen and level_distance(seen[0], place[:2]) < self._config.cover_distance:
                continue
            missed.append(place)
            yield from self._add_viewpoint(place, seen)
        if not missed or not len(beside):
            return
        tree = cKDTree(beside[:, :2])
        for place in missed:
            tries, covered = 0, self._is_covered(place)
            around = beside[tree.query_ball_point(place[:2], self._config.cover_distance, return_sorted=True)]
            for halfway in around[np.hypot(*(around[:, :2] - place[:2]).T) < self._config.cover_distance]:
                if tries == _HALFWAY or covered:
                    break
                seen = self._visible_viewpoints(halfway)
                if not seen or level_distance(seen[0], halfway[:2]) < self._config.merge_radius:
                    continue
                if self._walk.is_line_known(halfway, place):
                    tries += 1
                    yield from self._add_viewpoint(halfway, seen)
                    covered = self._is_covered(place)

    def fill_between(self, ways: DraftGraph) -> Iterator[tuple[Viewpoint, list[Viewpoint]]]:
        """Yield, as `fill_gaps`, viewpoints at positions that see viewpoints of several parts of the graph `ways`. For
        each pair of parts, they are those with the most room on the way, until one joins the parts."""
        ids, part_of = list(self._draft.viewpoints), ways.parts()
        beside = self._walk.positions_beside(self._config.half_width, _SPACING)
        if not len(beside) or len(set(part_of.values())) < 2:
            return
        between: dict[tuple[str, str], list[tuple[float, int]]] = {}
        seen: dict[int, list[Viewpoint]] = {}
        stand = cKDTree([self._draft.viewpoints[id].position[:2] for id in ids])
        for k, near in enumerate(stand.query_ball_point(beside[:, :2], self._config.tau_dist)):
            if len({part_of[ids[i]] for i in near}) < 2:
                continue
            seen[k] = self._visible_viewpoints(beside[k])
            nearest: dict[frozenset[str], Viewpoint] = {}
            for viewpoint in seen[k]:
                nearest.setdefault(part_of[viewpoint.id], viewpoint)
            ends = sorted((min(part), self._room_on_line(beside[k], v)) for part, v in nearest.items())
            for (a, one), (b, other) in combinations(ends, 2):
                between.setdefault((a, b), []).append((-min(one, other), k))
        for (a, b), tries in between.items():
            for _, k in sorted(tries)[:_BRIDGES]:
                if not math.isinf(ways.meters(a, b)):
                    break
                yield from self._add_viewpoint(beside[k], seen[k])

    def _room_on_line(self, place: NDArray[np.float64], viewpoint: Viewpoint) -> float:
        """The least distance to unknown floor on the line to a viewpoint, in meters."""
        line = place + np.linspace(0, 1, _LOOKS)[:, None] * (np.array(viewpoint.position) - place)
        return float(self._walk.clearance_at(line).min())

    def _are_covered(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) bool: whether one of the nearest viewpoints is near and in line with each position (N, 3). All are
        tested at once, because most are covered and stay covered while viewpoints are added."""
        covered = np.zeros(len(places), bool)
        stand = np.array([v.position for v in self._draft.viewpoints.values()]).reshape(-1, 3)
        most = self._config.cover_distance - SAME
        if not len(stand) or not len(places) or most <= 0:
            return covered
        apart_by, nearest = cKDTree(stand[:, :2]).query(places[:, :2], k=_NEAREST, distance_upper_bound=most)
        for meters, which in zip(apart_by.T, nearest.T, strict=True):
            at = np.flatnonzero(np.isfinite(meters) & ~covered)
            there = stand[which[at]]
            level = np.abs(there[:, 2] - places[at, 2]) <= STEEPEST * meters[at] + SAME_FLOOR - SAME
            at, there = at[level], there[level]
            covered[at[self._walk.are_lines_known(there, places[at])]] = True
        return covered

    def _is_covered(self, place: NDArray[np.floating]) -> bool:
        seen = self._visible_viewpoints(place)
        return bool(seen) and level_distance(seen[0], place[:2]) < self._config.cover_distance

    def _visible_viewpoints(self, place: NDArray[np.floating]) -> list[Viewpoint]:
        """Return the viewpoints within one step to which known floor leads straight, the nearest first."""
        near = self._draft.viewpoints_near(place, self._config.tau_dist)
        there = np.array([v.position for v in near]).reshape(-1, 3)
        found = self._walk.are_lines_known(there, np.broadcast_to(place, there.shape))
        return [v for v, line in zip(near, found.tolist(), strict=True) if line]

    def _add_viewpoint(
        self, place: NDArray[np.floating], seen: list[Viewpoint]
    ) -> Iterator[tuple[Viewpoint, list[Viewpoint]]]:
        if not self._survey.is_level(place):
            return
        viewpoint = self._survey.viewpoint(place, "step")
        seen = [v for v in seen if self._survey.knows_floor(viewpoint, v)][:_LINKS]
        if not seen or viewpoint.id in self._tried or viewpoint.id in self._draft.viewpoints:
            return  # also positions that another filler has tried have a viewpoint
        self._tried.add(viewpoint.id)
        self._survey.lattice.begin(viewpoint.id, viewpoint.position[:2])
        around = self._survey.around(viewpoint)
        if can_stand(around, self._config):
            self._survey.add_viewpoint(viewpoint, around)
            yield viewpoint, seen


_SPARE = 0.1  # meters of extra room on either side that most edges have
_NARROW = ((1.5, 0.05), (2.0, 0.025), (6.0, 0.0))  # (detour ratio, meters of extra room that then suffice)
_STEP = 0.3  # meters: a nook that has no room for a step of this length gets only one viewpoint
_LEAST = 0.025  # meters of extra room that one edge of a filling viewpoint must have


class Settling:
    """Rearranges the graph of a survey in place."""

    def __init__(self, survey: Survey, progress: Callable[[], None]) -> None:
        self._survey, self._draft, self._config = survey, survey.draft, survey.config
        self._progress = progress
        self._ways = DraftGraph(survey.draft)
        self._in_line: dict[tuple[str, str], bool] = {}

    def run(self) -> None:
        """Thin, join, restore connections, fill, bridge, and shorten."""
        edges = self._draft.edges()
        stands_for = self._find_replacements()
        kept = [id for id, by in stands_for.items() if id == by]
        self._ways.add(kept)
        self._join(kept, kept)
        self._restore(edges, stands_for)
        self._part()
        self._remove_unused()
        self._fill()
        self._bridge()
        self._shorten()
        self._part()
        self._remove_unused()
        remove_ties(self._ways)
        self._write()

    def _find_replacements(self) -> dict[str, str]:
        """Return id -> the viewpoint that replaces it: itself, or one that it sees within the merge radius. Viewpoints
        with the most room are kept first."""
        stands_for: dict[str, str] = {}
        for id in sorted(self._draft.viewpoints, key=lambda id: (-self._room(id), id)):
            viewpoint = self._draft.viewpoints[id]
            near = self._near_over_floor(viewpoint, self._config.merge_radius)
            kept = (v for v in near if stands_for.get(v.id) == v.id and self._is_open(viewpoint, v))
            stands_for[id] = next((v.id for v in kept), id)
        return stands_for

    def _join(self, new: Iterable[str], among: Iterable[str]) -> None:
        """Join viewpoints of `new` with those in `among`, the nearest pairs first, if their path in the graph is long.
        Corridors with extra room come first. Then follow narrower ones, if there is not even a detour."""
        inside, pairs = set(among), set()
        for id in new:
            for other in self._near_over_floor(self._draft.viewpoints[id], self._config.reach):
                if other.id in inside:
                    pairs.add((min(id, other.id), max(id, other.id)))
        length = {pair: self._ways.distance(*pair) for pair in pairs}
        order = sorted(pairs, key=lambda pair: (length[pair], pair))
        for stretch, spare in ((self._config.stretch, _SPARE), *_NARROW):
            for a, b in order:
                self._progress()
                most = stretch * length[a, b]
                ends = self._draft.viewpoints[a], self._draft.viewpoints[b]
                if self._ways.meters(a, b, most) > most and self._is_open(*ends, spare):
                    self._ways.join(a, b)

    def _restore(self, edges: list[tuple[str, str]], stands_for: dict[str, str]) -> None:
        """Restore both ends of edges of the search that were needed, such as in a door: the path between their
        replacements is a long detour, or there is none.

        Both ends are also restored if one viewpoint without neighbors replaces them and the edge is long enough for a
        step. A place where an agent can take a step, even a short one, then keeps it.
        """
        for a, b in edges:
            ends = stands_for[a], stands_for[b]
            was = sum(self._ways.distance(*pair) for pair in ((ends[0], a), (a, b), (b, ends[1])))
            alone = ends[0] == ends[1] and not self._ways.around(ends[0]) and self._ways.distance(a, b) >= _STEP
            if not alone and self._ways.meters(*ends, DETOUR * was) <= DETOUR * was:
                continue
            for id in (a, b):
                stands_for[id] = id
            self._ways.add((a, b))
            self._join((a, b), self._ways)
            if math.isinf(self._ways.meters(a, b)):
                self._ways.join(a, b)

    def _remove_unused(self) -> None:
        for id in [id for id in self._draft.viewpoints if id not in self._ways]:
            self._draft.remove(id)

    def _part(self) -> None:
        """Find pairs of near viewpoints on connected known floor that have no edge and no short path. Remove the one
        that fewer others reach, or else the one with less room, if the paths between its neighbors hardly grow.
        Otherwise, an agent beside its goal could not reach it."""
        near = []
        parts = self._ways.parts()
        for id in self._ways:
            for other in self._near_over_floor(self._draft.viewpoints[id], NEAR):
                if id < other.id and other.id in self._ways and self._ways.meters(id, other.id, 2 * NEAR) > 2 * NEAR:
                    near.append((id, other.id))
        for pair in near:
            for id in sorted(pair, key=lambda id: (len(parts[id]), self._room(id), id)):
                if all(end in self._ways for end in pair) and self._ways.is_redundant(id):
                    self._ways.remove(id)

    def _fill(self) -> None:
        if len(self._draft.viewpoints) >= self._config.max_viewpoints:
            return
        for viewpoint, seen in GapFiller(self._survey).fill_gaps():
            if not any(self._is_open(viewpoint, other, _LEAST) for other in seen):
                self._draft.remove(viewpoint.id)
                continue
            self._ways.add([viewpoint.id])
            self._join([viewpoint.id], self._ways)
            if len(self._draft.viewpoints) >= self._config.max_viewpoints:
                return

    def _bridge(self) -> None:
        for viewpoint, seen in GapFiller(self._survey).fill_between(self._ways):
            self._progress()
            parts, reach = self._ways.parts(), self._config.reach
            near = [other for other in seen if level_distance(other, viewpoint.position[:2]) <= reach]
            ends = [other for other in near if self._is_open(viewpoint, other)]
            if len({parts[end.id] for end in ends}) < 2 or len(self._draft.viewpoints) > self._config.max_viewpoints:
                self._draft.remove(viewpoint.id)
                continue
            self._ways.add([viewpoint.id])
            self._join([viewpoint.id], self._ways)

    def _shorten(self) -> None:
        def join(new: list[str]) -> None:
            self._ways.add(new)
            self._join(new, self._ways)

        for _ in Shortcuts(self._survey, self._ways, self._is_open, join).make():
            if len(self._draft.viewpoints) >= self._config.max_viewpoints:
                return
            self._progress()

    def _write(self) -> None:
        """Write the edges to the graph. Write to the evidence of open corridors why they have no edge."""
        draft = self._draft
        for a, b in draft.edges():
            draft.remove_edge(a, b)
        for a, b in self._ways.edges():
            step = draft.step_towards(draft.viewpoints[a], draft.viewpoints[b])
            draft.join(a, b, "merge" if step is None else "step")
        for id, viewpoint in draft.viewpoints.items():
            for evidence in list(draft.evidence[id].values()):
                if evidence.decision != OPEN:
                    continue
                at = [
                    v
                    for v in draft.viewpoints_near(self._survey.arrival(viewpoint, evidence.target), SAME)
                    if v.id != id
                ]
                if not at:
                    draft.store_evidence(replace(evidence, decision="served"))
                elif not draft.are_joined(id, at[0].id):
                    back = self._survey.known(at[0], viewpoint) if self._config.both_ways else OPEN
                    draft.store_evidence(replace(evidence, decision="spare" if back in (OPEN, "") else "return"))

    def _room(self, id: str) -> float:
        """Decimeters to the nearest unknown floor."""
        place = np.array([self._draft.viewpoints[id].position])
        return round(10 * float(self._survey.walk.clearance_at(place)[0]))

    def _near_over_floor(self, viewpoint: Viewpoint, reach: float) -> list[Viewpoint]:
        """Return other viewpoints within `reach` to which known floor leads straight, the nearest first."""
        here, known = np.array(viewpoint.position), self._in_line
        others = [v for v in self._draft.viewpoints_near(here, reach) if v.id != viewpoint.id]
        new = [v for v in others if (viewpoint.id, v.id) not in known]
        there = np.array([v.position for v in new]).reshape(-1, 3)
        found = self._survey.walk.are_lines_known(np.broadcast_to(here, there.shape), there)
        known.update(((viewpoint.id, v.id), bool(line)) for v, line in zip(new, found, strict=True))
        return [v for v in others if known[viewpoint.id, v.id]]

    def _viewpoints_in_range(self, viewpoint: Viewpoint) -> Iterator[Viewpoint]:
        """Yield the viewpoints that are near enough for an edge. They are searched only when they are needed."""
        yield from self._near_over_floor(viewpoint, self._config.reach)

    def _is_open(self, a: Viewpoint, b: Viewpoint, spare: float = 0.0) -> bool:
        """Whether the corridor between two viewpoints is free, in both directions if required, with `spare` meters of
        extra room on either side."""
        for here, there in ((a, b), (b, a)) if self._config.both_ways else ((a, b),):
            if self._survey.decide_corridor(here, there, self._viewpoints_in_range(here)) != OPEN:
                return False
            if spare and self._survey.known(here, there, spare) != OPEN:
                return False
        return True
