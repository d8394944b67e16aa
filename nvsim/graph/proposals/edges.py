"""Edges to propose: near viewpoints that are not joined, although the evidence or the map says that the way is free."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.components import components
from nvsim.graph.edits.change import key_of
from nvsim.graph.edits.edges import Visible
from nvsim.graph.quantities import Margin, evidence_along
from nvsim.graph.types import EdgeKey, NavGraph, Viewpoint
from nvsim.occupancy.types import OCCUPIED, OccupancyMap

DETOUR = 1.5
"""Times the straight way: who gets there with no more needs no edge of his own."""
_LEVEL = 0.5  # metres between the floors of two viewpoints: the map knows one floor
_FAR = 20.0  # metres: ways beyond are all the same
_SURE = 0.3  # margin of evidence that leaves no doubt
_MAP_ALONE = 0.6  # confidence where only the map speaks; the least of evidence is below
_GLASS = 0.5  # times as sure, where the trajectory leads far around and no scan shows why
_LISTED = 0.3  # what sees another need not be able to walk there


@dataclass(frozen=True)
class EdgeProposal:
    """edge    its key
    score   0 to 1: how sure it is that the way is free, times how much of today's way it saves
    length  metres, straight
    today   metres of the way between the two in the graph; infinite where there is none, or none under 20 m
    words   one sentence
    """

    edge: EdgeKey
    score: float
    length: float
    today: float
    words: str


def propose_edges(
    graph: NavGraph,
    occupancy: OccupancyMap | None = None,
    margin: Margin | None = None,
    *,
    visible: Visible | None = None,
    reach: float = 3.5,
    radius: float = 0.25,
) -> tuple[EdgeProposal, ...]:
    """The best first. Pairs of included viewpoints within `reach` metres are proposed when their stored evidence is
    open (`margin` above 0) and no occupied cell lies between them, or, where nothing was measured, when a disc of
    `radius` metres can go straight from one to the other on the map. Evidence that speaks against an edge outweighs
    the map. Where neither is known, `visible` may say who sees whom, of which less follows.

    Of the pairs that pass, the shortest come first, and who is reached by less than DETOUR times the straight way is
    not proposed any more: a greedy spanner (Althoefer et al. 1993, On Sparse Spanners of Weighted Graphs).
    """
    import networkx as nx

    pairs = _pairs(graph, reach)
    confidence = _confidence(graph, pairs, occupancy, margin, radius)
    if visible is not None:
        confidence = _listed(graph, [key for key in pairs if key not in confidence], visible) | confidence
    length = {key: _apart(graph, key) for key in pairs}
    ways = nx.Graph()
    ways.add_nodes_from(id for id, v in graph.viewpoints.items() if v.included)
    ways.add_weighted_edges_from((a, b, _apart(graph, (a, b))) for a, b in graph.edges if a in ways and b in ways)
    chosen = []
    for key in sorted(confidence, key=lambda k: (length[k] / confidence[k][0], k)):
        a, b = key
        if math.isinf(_way(ways, a, b, DETOUR * length[key])):
            chosen.append(key)
            ways.add_edge(a, b, weight=length[key])
    ways.remove_edges_from(chosen)
    group = {id: i for i, ids in enumerate(components(graph)) for id in ids}
    found = []
    for key in chosen:
        a, b = key
        apart = group.get(a) != group.get(b)
        today = math.inf if apart else _way(ways, a, b, _FAR)
        sure, why = confidence[key]
        score = sure * (1.0 if math.isinf(today) else 1.0 - length[key] / today)
        found.append(EdgeProposal(key, score, length[key], today, _words(length[key], today, apart, why)))
    return tuple(sorted(found, key=lambda p: (-p.score, p.edge)))


def _pairs(graph: NavGraph, reach: float) -> list[EdgeKey]:
    """Keys of the included viewpoints within `reach` on one floor that are not joined and do not coincide."""
    from scipy.spatial import cKDTree

    ids = [id for id, v in graph.viewpoints.items() if v.included]
    if len(ids) < 2:
        return []
    places = np.array([graph.viewpoints[id].position for id in ids])
    floor = np.array([_floor(graph.viewpoints[id]) for id in ids])
    rows = cKDTree(places).query_pairs(reach, output_type="ndarray")
    rows = rows[np.abs(floor[rows[:, 0]] - floor[rows[:, 1]]) <= _LEVEL]
    rows = rows[np.linalg.norm(places[rows[:, 0]] - places[rows[:, 1]], axis=1) > 0]
    keys = (key_of(ids[i], ids[j]) for i, j in rows.tolist())
    return sorted(key for key in keys if key not in graph.edges)


def _confidence(
    graph: NavGraph, pairs: list[EdgeKey], occupancy: OccupancyMap | None, margin: Margin | None, radius: float
) -> dict[EdgeKey, tuple[float, str]]:
    """How sure (0 to 1) and why, of the pairs that may be joined."""
    clear, blocked = _on_map(graph, pairs, occupancy, radius)
    found: dict[EdgeKey, tuple[float, str]] = {}
    for key, is_clear, is_blocked in zip(pairs, clear.tolist(), blocked.tolist(), strict=True):
        slack = margin(graph, key) if margin is not None and graph.evidence else math.nan
        if math.isnan(slack):
            if is_clear:
                found[key] = (_MAP_ALONE, "the map shows the way between them free")
        elif slack > 0 and not is_blocked:
            sure = 0.5 + 0.3 * min(1.0, slack / _SURE) + (0.2 if is_clear else 0.0)
            glass = any(e.decision == "around" for e in evidence_along(graph, key))
            words = "the corridor between them passes" + (" and the map agrees" if is_clear else "")
            found[key] = (_GLASS * sure, f"{words}, unless a pane of glass stands there") if glass else (sure, words)
    return found


def _listed(graph: NavGraph, pairs: list[EdgeKey], visible: Visible) -> dict[EdgeKey, tuple[float, str]]:
    """The pairs that see each other."""
    if not pairs:
        return {}
    a, b = (np.array([graph.viewpoints[key[end]].position for key in pairs]) for end in (0, 1))
    seen = zip(pairs, visible(a, b).tolist(), strict=True)
    return {key: (_LISTED, "see each other by the lists of the file") for key, there in seen if there}


def _on_map(
    graph: NavGraph, pairs: list[EdgeKey], occupancy: OccupancyMap | None, radius: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(P,) whether a disc can go there over free cells, and (P,) whether something occupied lies between."""
    nothing = np.zeros(len(pairs), np.bool_)
    if occupancy is None or not pairs:
        return nothing, nothing
    from nvsim.occupancy.paths import segments_are_free, standing_room

    a, b = (np.array([graph.viewpoints[key[end]].position[:2] for key in pairs]) for end in (0, 1))
    rows, columns = occupancy.cells.shape
    ends = np.concatenate([occupancy.index(a), occupancy.index(b)], axis=1)
    # Beyond the map nothing is known to be occupied.
    inside = ((ends >= 0) & (ends < [rows, columns, rows, columns])).all(axis=1)
    passes = segments_are_free(occupancy.cells != OCCUPIED, occupancy, a, b)
    return segments_are_free(standing_room(occupancy, radius), occupancy, a, b), inside & ~passes


def _way(ways: Any, start: str, end: str, limit: float) -> float:
    """Metres of the shortest way in a networkx graph, infinite where it is longer than `limit`."""
    import networkx as nx

    try:
        return float(nx.single_source_dijkstra(ways, start, end, cutoff=limit)[0])
    except nx.NetworkXNoPath:
        return math.inf


def _words(length: float, today: float, apart: bool, why: str) -> str:
    if apart:
        now = "no way leads from one to the other today"
    elif math.isinf(today):
        now = f"today's way is longer than {_FAR:.0f} m"
    else:
        now = f"today's way is {today:.1f} m"
    return f"They stand {length:.1f} m apart and {why}; {now}."


def _floor(v: Viewpoint) -> float:
    return v.position[2] - v.height


def _apart(graph: NavGraph, key: EdgeKey) -> float:
    return math.dist(graph.viewpoints[key[0]].position, graph.viewpoints[key[1]].position)
