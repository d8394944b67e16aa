"""Decide the edges between the viewpoints of a graph under other thresholds, from the stored evidence alone. This is
fast enough to follow a slider.

Only corridors between existing viewpoints can be decided. If a step leads to a new position, a build with the graph as
`previous` has to render it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.touched_elements import TouchedElements, remember
from nvsim.graph.types import Decision, Edge, EdgeOrigin, NavGraph, edge
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import OPEN, SPARED
from nvsim.mapping.evidence.evidence_stack import EvidenceStack, decision_names
from nvsim.mapping.search.graph_builder import SAME

MACHINE = frozenset({"step", "merge"})  # origins of edges that the thresholds decide
_OPEN = 0  # the code of OPEN


@dataclass(frozen=True, eq=False)
class ThresholdEffect:
    """The effect of `config` on the graph.

    new_edges, lost_edges  (M, 2) rows of the viewpoints that gain or lose an edge
    kept_by_user           number of edges that the thresholds refuse but that a user made or locked
    isolated_viewpoints    number of viewpoints that lose their last edge
    new_steps              number of steps that newly open toward positions without a viewpoint; only a new build goes
                           there
    one_way_measured       number of edges that appear although the corridor back was not measured
    codes                  (E,) decisions of the evidence, see `EvidenceStack.decide`
    blocked_pairs          (E,) whether a corridor belongs to a pair of viewpoints without a free path
    """

    config: MappingConfig
    new_edges: NDArray[np.int64]
    lost_edges: NDArray[np.int64]
    kept_by_user: int
    isolated_viewpoints: int
    new_steps: int
    one_way_measured: int
    codes: NDArray[np.uint8] = field(repr=False)
    blocked_pairs: NDArray[np.bool_] = field(repr=False)

    def __bool__(self) -> bool:
        return bool(len(self.new_edges) or len(self.lost_edges))


class Rethresholder:
    """Decides the corridors of one graph, as often as needed."""

    def __init__(self, graph: NavGraph, walk: NDArray[np.floating] | None = None) -> None:
        """`walk` (N, 3): camera positions, meters, for the distance from the trajectory. Without it, the distance is
        not checked."""
        self.graph = graph
        self.ids = tuple(graph.viewpoints)
        row = {id: i for i, id in enumerate(self.ids)}
        count = len(self.ids)
        self._evidence = [e for e in graph.evidence.values() if e.viewpoint in row and not e.stale]
        self._at = np.array([row[e.viewpoint] for e in self._evidence], np.int64)
        self._stack = EvidenceStack(self._evidence, self._at, count)
        viewpoints = graph.viewpoints.values()
        self._start = np.array([v.origin == "start" for v in viewpoints], bool)
        self._machine = np.array([v.origin in ("start", "step") for v in viewpoints], bool)
        xy = np.array([v.position[:2] for v in viewpoints], np.float64).reshape(-1, 2)
        self._lead = self._end_rows(row, xy)
        self._far = np.zeros(count) if walk is None or not len(walk) else _distances(xy, np.asarray(walk)[:, :2])
        self._pair(count)
        self._match_edges(row)
        # Edges that settling omitted are not added, because another path exists.
        stored = np.array([e.decision == OPEN or e.decision in SPARED for e in self._evidence], bool)
        self._stored = _values_at_rows(self._forward, stored) | _values_at_rows(self._backward, stored)
        # Steps that a threshold stopped when the graph was built.
        self._stopped = np.array([e.decision in decision_names()[1:] and not e.joins for e in self._evidence], bool)

    def _end_rows(self, row: Mapping[str, int], xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """(E,) row of the viewpoint at the end of the corridor, -1 if there is none."""
        lead = np.full(len(self._evidence), -1, np.int64)
        if not len(xy) or not self._evidence:
            return lead
        targets = np.array([e.target for e in self._evidence], np.float64)
        # Sorted cells of 10 cm. A viewpoint within SAME of the target is in the cell of the target or in an adjacent
        # one.
        keys = _cell(np.floor(xy * 10).astype(np.int64))
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        for dx in (-SAME, SAME):
            for dy in (-SAME, SAME):
                key = _cell(np.floor((targets + [dx, dy]) * 10).astype(np.int64))
                low, high = np.searchsorted(keys, key), np.searchsorted(keys, key, side="right")
                for step in range(int((high - low).max(initial=0))):
                    among = np.flatnonzero(low + step < high)
                    found = order[low[among] + step]
                    near = np.hypot(*(xy[found] - targets[among]).T) < SAME
                    lead[among[near]] = found[near]
        named = np.array([row.get(e.joins, -1) for e in self._evidence], np.int64)
        joins = np.array([bool(e.joins) for e in self._evidence], bool)
        # A corridor to a viewpoint that was moved or removed leads nowhere.
        lead[joins & (named != lead)] = -1
        lead[lead == self._at] = -1
        return lead

    def _pair(self, count: int) -> None:
        """Pair the evidence of both directions between all viewpoints that evidence connects: _a, _b (P,) rows, a < b.
        _forward (from a to b) and _backward are (P,) rows of the evidence, -1 if there is none."""
        joins = np.array([bool(e.joins) for e in self._evidence], bool)
        used = np.flatnonzero(self._lead >= 0)
        # A step takes precedence over a corridor that was measured to the viewpoint.
        used = used[np.argsort(joins[used], kind="stable")]
        a, b = self._at[used], self._lead[used]
        key = np.minimum(a, b) * max(1, count) + np.maximum(a, b)
        pairs, place = np.unique(key, return_inverse=True)
        self._a, self._b = pairs // max(1, count), pairs % max(1, count)
        self._forward = np.full(len(pairs), -1, np.int64)
        self._backward = np.full(len(pairs), -1, np.int64)
        for way, mine in ((self._forward, a < b), (self._backward, a > b)):
            rows = np.flatnonzero(mine)[::-1]  # the row that takes precedence is written last
            way[place[rows]] = used[rows]

    def _match_edges(self, row: Mapping[str, int]) -> None:
        ends = {(min(row[a], row[b]), max(row[a], row[b])): e for (a, b), e in self.graph.edges.items()}
        held = [ends.get((int(a), int(b))) for a, b in zip(self._a, self._b, strict=True)]
        self._present = np.array([e is not None for e in held], bool)
        free = [e is not None and e.origin in MACHINE and not e.locked for e in held]
        self._free = np.array(free, bool)
        self._degree = np.bincount(np.array(list(ends), np.int64).reshape(-1), minlength=len(self.ids))

    def decide(self, config: MappingConfig) -> ThresholdEffect:
        """Return the effect of `config` on the graph."""
        codes = self._stack.decide(config)
        passes = codes == _OPEN
        there, back = _values_at_rows(self._forward, passes), _values_at_rows(self._backward, passes)
        if config.both_ways:
            is_open = (there | (self._forward < 0)) & (back | (self._backward < 0))
        else:
            is_open = there | back
        # As in the search: under rule mean, only the floor of starts is checked.
        may = self._stack.can_stand(config) | ~self._machine | (not config.standing)
        may |= ~self._start if config.rule == "mean" else False
        may &= (self._far <= (config.max_distance or np.inf)) | ~self._machine | self._start
        is_open &= may[self._a] & may[self._b]
        appear = is_open & ~self._present & ~self._stored
        refused = ~is_open & self._present
        disappear = refused & self._free
        degree = self._degree.copy()
        for sign, which in ((1, appear), (-1, disappear)):
            for end in (self._a, self._b):
                degree += sign * np.bincount(end[which], minlength=len(degree))
        one_way = (self._forward < 0) | (self._backward < 0)
        closed = np.zeros(len(codes), bool)
        for way in (self._forward, self._backward):
            closed[way[(way >= 0) & ~is_open]] = True
        return ThresholdEffect(
            config,
            np.stack([self._a[appear], self._b[appear]], axis=1),
            np.stack([self._a[disappear], self._b[disappear]], axis=1),
            int((refused & ~self._free).sum()),
            int(((degree == 0) & (self._degree > 0)).sum()),
            int((passes & (self._lead < 0) & self._stopped).sum()),
            int((appear & one_way).sum()) if config.both_ways else 0,
            codes,
            closed,
        )

    def apply(self, redecision: ThresholdEffect) -> NavGraph:
        """Return the graph with the edges of `redecision`, and with its decisions in the evidence."""
        edges: dict[tuple[str, str], Edge] = dict(self.graph.edges)
        for a, b in redecision.lost_edges.tolist():
            del edges[edge(self.ids[a], self.ids[b]).key]
        origins = self._origins()
        for a, b in redecision.new_edges.tolist():
            made = edge(self.ids[a], self.ids[b], origins[a, b])
            edges[made.key] = made
        evidence, changed = dict(self.graph.evidence), []
        for i, e in enumerate(self._evidence):
            word = self._word(i, int(redecision.codes[i]), bool(redecision.blocked_pairs[i]))
            if word != e.decision:
                evidence[e.key] = replace(e, decision=word)
                changed.append(e.key)
        after = replace(self.graph, edges=edges, evidence=evidence)
        pairs = np.concatenate([redecision.lost_edges, redecision.new_edges]).tolist()
        touched = tuple(edge(self.ids[a], self.ids[b]).key for a, b in pairs)
        remember(after, self.graph, TouchedElements((), touched, tuple(changed)))
        return after

    def _word(self, i: int, code: int, closed: bool) -> Decision:
        """Return the decision of evidence `i`. Decisions of settling or of the search that do not depend on thresholds
        stay, because the evidence cannot decide them."""
        was = self._evidence[i].decision
        if was in SPARED:
            return was
        if code != _OPEN:
            return decision_names()[code]
        if closed:
            return "return" if was in decision_names() else was
        refused = was == "return" and self._lead[i] < 0  # there is no room for a viewpoint
        return OPEN if was in (*decision_names(), "return") and not refused else was

    def _origins(self) -> dict[tuple[int, int], EdgeOrigin]:
        result: dict[tuple[int, int], EdgeOrigin] = {}
        for a, b, there, back in zip(self._a, self._b, self._forward, self._backward, strict=True):
            steps = [not self._evidence[k].joins for k in (there, back) if k >= 0]
            result[int(a), int(b)] = "step" if any(steps) else "merge"
        return result


def _values_at_rows(way: NDArray[np.int64], values: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(P,) values at the rows of `way`, False for -1."""
    if not len(values):
        return np.zeros(len(way), bool)
    return values[way] & (way >= 0)


def _cell(place: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) one number for each cell (N, 2)."""
    return place[:, 0] * np.int64(2**31) + place[:, 1]


def _distances(xy: NDArray[np.float64], walk: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) meters from each of (N, 2) to the nearest of (M, 2)."""
    nearest = np.empty(len(xy))
    for first in range(0, len(xy), 256):
        part = xy[first : first + 256]
        nearest[first : first + 256] = np.hypot(*(part[:, None] - walk[None]).transpose(2, 0, 1)).min(axis=1)
    return nearest
