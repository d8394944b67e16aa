"""From the lattices that a search leaves to a graph to live in.

Searches from several starts leave lattices that lie over each other: viewpoints a metre apart that no edge joins, and
many ways of one length. So of viewpoints that stand close and see each other one stays; near ones are joined where the
corridor passes both ways and the graph's way is a detour (a greedy spanner, Althoefer et al. 1993, On Sparse Spanners
of Weighted Graphs); what hung together before still does, at little more way; and places that no viewpoint is near to
get one, at the end of a shorter step. The criteria are those of the search throughout.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from nvsim.graph.types import Viewpoint
from nvsim.mapping.criteria import OPEN, can_stand
from nvsim.mapping.graph_builder import SAME, apart
from nvsim.mapping.survey import Survey
from nvsim.mapping.ties import untie

_DETOUR = 1.5  # times as long as it was, a way may be after thinning
_LINKS = 6  # viewpoints that one that fills a gap may be joined to
_NEAR = 1.5  # metres; half of what R2R calls arrived
_SPACING = 0.3  # metres between the places that are tried


class Settling:
    """Rearranges the graph of a survey in place."""

    def __init__(self, survey: Survey, should_stop: Callable[[], bool], progress: Callable[[], None]) -> None:
        import networkx as nx

        self._survey, self._draft, self._config = survey, survey.draft, survey.config
        self._should_stop, self._progress = should_stop, progress
        self._ways = nx.Graph()
        self._room: dict[str, float] = {}

    def run(self) -> None:
        """Thins, joins, restores what hung together, and fills. A run that is stopped leaves the search's graph."""
        found, edges = dict(self._draft.viewpoints), self._draft.edges()
        stands_for = self._thin()
        kept = [id for id, by in stands_for.items() if id == by]
        self._ways.add_nodes_from(kept)
        self._join(kept, kept)
        self._restore(found, edges, stands_for)
        if self._should_stop():
            return
        self._part()
        for id in [id for id in found if id not in self._ways]:
            self._draft.remove(id)
        self._fill()
        untie(self._ways, self._can_spare_edge)
        self._write()

    def _thin(self) -> dict[str, str]:
        """id -> the viewpoint that stays in its place: itself, or one that it sees nearer than the merge radius. Those
        with the most room come first."""
        ids = list(self._draft.viewpoints)
        places = np.array([self._draft.viewpoints[id].position[:2] for id in ids])
        room = np.round(self._survey.walk.clearance_at(places), 1)
        self._room = dict(zip(ids, room.tolist(), strict=True))
        stands_for: dict[str, str] = {}
        for id in sorted(ids, key=lambda id: (-self._room[id], id)):
            viewpoint = self._draft.viewpoints[id]
            near = self._near(viewpoint, self._config.merge_radius)
            kept = (v for v in near if stands_for.get(v.id) == v.id and self._is_open(viewpoint, v))
            stands_for[id] = next((v.id for v in kept), id)
        return stands_for

    def _join(self, new: Iterable[str], among: Iterable[str]) -> None:
        """Joins viewpoints of `new` with those `among` all, the nearest pairs first, where the way so far is long."""
        inside, pairs = set(among), set()
        for id in new:
            for other in self._near(self._draft.viewpoints[id], self._config.reach):
                if other.id in inside:
                    pairs.add((min(id, other.id), max(id, other.id)))
        length = {pair: self._apart(*pair) for pair in pairs}
        for a, b in sorted(pairs, key=lambda pair: (length[pair], pair)):
            if self._should_stop():
                return
            self._progress()
            most = self._config.stretch * length[a, b]
            if self._way(a, b, most) > most and self._is_open(self._draft.viewpoints[a], self._draft.viewpoints[b]):
                self._ways.add_edge(a, b, weight=length[a, b])

    def _restore(self, found: dict[str, Viewpoint], edges: list[tuple[str, str]], stands_for: dict[str, str]) -> None:
        """Brings back both ends of an edge of the search where the way between what stands for them is a long detour or
        none: they were needed, in a door for example."""
        for a, b in edges:
            if self._should_stop():
                return
            ends = stands_for[a], stands_for[b]
            was = self._apart(ends[0], a) + self._apart(a, b) + self._apart(b, ends[1])
            if ends[0] == ends[1] or self._way(*ends, _DETOUR * was) <= _DETOUR * was:
                continue
            for id in (a, b):
                stands_for[id] = id
            self._ways.add_nodes_from((a, b))
            self._join((a, b), list(self._ways))
            if math.isinf(self._way(a, b, math.inf)):
                self._ways.add_edge(a, b, weight=self._apart(a, b))

    def _part(self) -> None:
        """Of two near viewpoints that known floor joins but no edge, and no short way either, takes out the one with
        less room where the ways between those around it hardly grow: an agent beside its goal should get there."""
        near = []
        for id in self._ways:
            for other in self._near(self._draft.viewpoints[id], _NEAR):
                if id < other.id and other.id in self._ways and math.isinf(self._way(id, other.id, 2 * _NEAR)):
                    near.append((id, other.id))
        for pair in near:
            for id in sorted(pair, key=lambda id: (self._room[id], id)):
                if all(end in self._ways for end in pair) and self._can_spare(id):
                    self._ways.remove_node(id)

    def _can_spare(self, id: str) -> bool:
        """Whether those around a viewpoint reach each other without it."""
        around = list(self._ways[id])
        rest = self._ways.subgraph(set(self._ways) - {id})
        for i, a in enumerate(around):
            for b in around[:i]:
                most = _DETOUR * (self._apart(a, id) + self._apart(id, b))
                if _way(rest, a, b, most) > most:
                    return False
        return True

    def _can_spare_edge(self, a: str, b: str) -> bool:
        """Whether another way joins its ends that is no long detour, nor too long for viewpoints that are near."""
        length = self._apart(a, b)
        most = min(_DETOUR * length, 2 * _NEAR if length < _NEAR else math.inf)
        kept = self._ways.edges[a, b]
        self._ways.remove_edge(a, b)
        found = self._way(a, b, most)
        self._ways.add_edge(a, b, **kept)
        return found <= most

    def _fill(self) -> None:
        """Puts viewpoints where the trajectory or known floor has none near, and where one can stand and step to one
        that is there: those with the most room first."""
        walk, config = self._survey.walk, self._config
        beside = walk.beside(config.half_width, _SPACING)
        for place in np.concatenate([walk.places, beside]):
            if self._should_stop():
                return
            near = self._draft.near(place[:2], config.tau_dist)
            seen = [v for v in near if walk.in_line(np.array(v.position[:2]), place[:2])]
            if not seen or apart(seen[0], place[:2]) < config.cover_distance:
                continue
            viewpoint = self._survey.viewpoint(place[:2], "step", float(place[2]))
            seen = [v for v in seen if self._survey.knows_floor(viewpoint, v)]
            if not seen:
                continue
            self._survey.lattice.begin(viewpoint.id, viewpoint.position[:2])
            around = self._survey.around(viewpoint)
            if not can_stand(around, config):
                continue
            self._survey.take(viewpoint, around)
            if not any(self._is_open(viewpoint, other) for other in seen[:_LINKS]):
                self._draft.remove(viewpoint.id)
                continue
            self._ways.add_node(viewpoint.id)
            self._join([viewpoint.id], list(self._ways))

    def _write(self) -> None:
        """The edges into the graph, and into the evidence why there is none where the corridor is open."""
        draft = self._draft
        for a, b in draft.edges():
            draft.cut(a, b)
        for a, b in self._ways.edges:
            step = draft.step_towards(draft.viewpoints[a], draft.viewpoints[b])
            draft.join(a, b, "merge" if step is None else "step")
        for id, viewpoint in draft.viewpoints.items():
            for evidence in list(draft.evidence[id].values()):
                if evidence.decision != OPEN:
                    continue
                target = np.array(evidence.target)
                at = [v for v in draft.near(target, SAME) if v.id != id]
                if not at:
                    self._survey.keep(replace(evidence, decision="served"))
                elif not draft.are_joined(id, at[0].id):
                    back = self._survey.way(at[0], viewpoint) if self._config.both_ways else OPEN
                    self._survey.withdraw(id, at[0], "spare" if back == OPEN else "return")

    def _near(self, viewpoint: Viewpoint, reach: float) -> list[Viewpoint]:
        """Others within reach that known floor leads straight to, the nearest first."""
        here = np.array(viewpoint.position[:2])
        others = (v for v in self._draft.near(here, reach) if v.id != viewpoint.id)
        return [v for v in others if self._survey.walk.in_line(here, np.array(v.position[:2]))]

    def _is_open(self, a: Viewpoint, b: Viewpoint) -> bool:
        """Whether the corridor between two viewpoints passes, both ways where that is asked."""
        for here, there in ((a, b), (b, a)) if self._config.both_ways else ((a, b),):
            if self._survey.way(here, there, self._near(here, self._config.reach)) != OPEN:
                return False
        return True

    def _way(self, a: str, b: str, most: float) -> float:
        return _way(self._ways, a, b, most)

    def _apart(self, a: str, b: str) -> float:
        return math.dist(self._draft.viewpoints[a].position[:2], self._draft.viewpoints[b].position[:2])


def _way(ways: Any, a: str, b: str, most: float) -> float:
    """Metres of the way between two viewpoints in a networkx graph, infinite where it is longer than `most`."""
    import networkx as nx

    try:
        return float(nx.single_source_dijkstra(ways, a, b, cutoff=most)[0])
    except nx.NetworkXNoPath:
        return math.inf
