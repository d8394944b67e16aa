"""Propose edges: near viewpoints that are not joined, although the evidence or the map shows a free path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.edits.change import key_of
from nvsim.graph.edits.edges import Visible
from nvsim.graph.paths import components
from nvsim.graph.quantities import Margin, evidence_along
from nvsim.graph.types import EdgeKey, NavGraph, Viewpoint
from nvsim.occupancy.types import OCCUPIED, OccupancyMap

DETOUR = 1.5
"""Ratio to the straight distance. A pair with a path of at most this ratio needs no edge."""
_LEVEL = 0.5  # maximum height difference in meters of two floors: the map covers one floor
_FAR = 20.0  # meters: longer paths are treated as equal
_SURE = 0.3  # margin at which evidence counts as certain
_MAP_ALONE = 0.6  # confidence from the map alone; the lowest confidence from evidence is smaller
_GLASS = 0.5  # factor on the confidence if a glass pane may be on the edge and no LiDAR scan shows it
_LISTED = 0.3  # visible does not imply traversable


@dataclass(frozen=True)
class EdgeProposal:
    """A proposed edge.

    edge    its key
    score   0 to 1: confidence that the path is free, times the share of the current path that the edge saves
    length  meters, straight
    today   meters of the current path in the graph; infinite if there is none of at most 20 m
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
    """Propose edges between included viewpoints within `reach` meters, the best first.

    A pair qualifies if its stored evidence is open (`margin` above 0) and no occupied cell is between the two. Without
    evidence, it qualifies if a disc of `radius` meters can move straight between them on the map. Evidence against an
    edge outweighs the map. If neither is known, `visible` gives the line of sight, with a low confidence.

    Qualified pairs are processed from the shortest. A pair is skipped if a path of less than DETOUR times the straight
    distance joins it: a greedy spanner (Althoefer et al. 1993, On Sparse Spanners of Weighted Graphs).
    """
    import networkx as nx

    pairs = _pairs(graph, reach)
    confidence = _confidence(graph, pairs, occupancy, margin, radius)
    if visible is not None:
        confidence = _visible_pairs(graph, [key for key in pairs if key not in confidence], visible) | confidence
    length = {key: _edge_length(graph, key) for key in pairs}
    ways = nx.Graph()
    ways.add_nodes_from(id for id, v in graph.viewpoints.items() if v.included)
    ways.add_weighted_edges_from((a, b, _edge_length(graph, (a, b))) for a, b in graph.edges if a in ways and b in ways)
    chosen = []
    for key in sorted(confidence, key=lambda k: (length[k] / confidence[k][0], k)):
        a, b = key
        if math.isinf(_shortest_path_length(ways, a, b, DETOUR * length[key])):
            chosen.append(key)
            ways.add_edge(a, b, weight=length[key])
    ways.remove_edges_from(chosen)
    group = {id: i for i, ids in enumerate(components(graph)) for id in ids}
    found = []
    for key in chosen:
        a, b = key
        apart = group.get(a) != group.get(b)
        today = math.inf if apart else _shortest_path_length(ways, a, b, _FAR)
        sure, why = confidence[key]
        score = sure * (1.0 if math.isinf(today) else 1.0 - length[key] / today)
        found.append(EdgeProposal(key, score, length[key], today, _words(length[key], today, apart, why)))
    return tuple(sorted(found, key=lambda p: (-p.score, p.edge)))


def _pairs(graph: NavGraph, reach: float) -> list[EdgeKey]:
    """Return the keys of included viewpoints within `reach` on one floor that are not joined and not at one
    position."""
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
    """Return the confidence (0 to 1) and the reason for the pairs that may be joined."""
    clear, blocked = _on_map(graph, pairs, occupancy, radius)
    found: dict[EdgeKey, tuple[float, str]] = {}
    for key, is_clear, is_blocked in zip(pairs, clear.tolist(), blocked.tolist(), strict=True):
        slack = margin(graph, key) if margin is not None and graph.evidence else math.nan
        if math.isnan(slack):
            if is_clear:
                found[key] = (_MAP_ALONE, "the map shows a free path between them")
        elif slack > 0 and not is_blocked:
            sure = 0.5 + 0.3 * min(1.0, slack / _SURE) + (0.2 if is_clear else 0.0)
            glass = any(e.decision == "around" for e in evidence_along(graph, key))
            words = "the corridor between them is free" + (" and the map agrees" if is_clear else "")
            found[key] = (_GLASS * sure, f"{words}, unless it contains a glass pane") if glass else (sure, words)
    return found


def _visible_pairs(graph: NavGraph, pairs: list[EdgeKey], visible: Visible) -> dict[EdgeKey, tuple[float, str]]:
    """Return the pairs that see each other."""
    if not pairs:
        return {}
    a, b = (np.array([graph.viewpoints[key[end]].position for key in pairs]) for end in (0, 1))
    seen = zip(pairs, visible(a, b).tolist(), strict=True)
    return {key: (_LISTED, "see each other according to the lists of the file") for key, there in seen if there}


def _on_map(
    graph: NavGraph, pairs: list[EdgeKey], occupancy: OccupancyMap | None, radius: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return (P,) whether a disc can move between the two over free cells, and (P,) whether an occupied cell is between
    them."""
    nothing = np.zeros(len(pairs), np.bool_)
    if occupancy is None or not pairs:
        return nothing, nothing
    from nvsim.occupancy.paths import segments_are_free, standing_room

    a, b = (np.array([graph.viewpoints[key[end]].position[:2] for key in pairs]) for end in (0, 1))
    rows, columns = occupancy.cells.shape
    ends = np.concatenate([occupancy.index(a), occupancy.index(b)], axis=1)
    # Outside the map no cell is known to be occupied.
    inside = ((ends >= 0) & (ends < [rows, columns, rows, columns])).all(axis=1)
    passes = segments_are_free(occupancy.cells != OCCUPIED, occupancy, a, b)
    return segments_are_free(standing_room(occupancy, radius), occupancy, a, b), inside & ~passes


def _shortest_path_length(ways: Any, start: str, end: str, limit: float) -> float:
    """Return the meters of the shortest path in a networkx graph; infinite if it is longer than `limit`."""
    import networkx as nx

    try:
        return float(nx.single_source_dijkstra(ways, start, end, cutoff=limit)[0])
    except nx.NetworkXNoPath:
        return math.inf


def _words(length: float, today: float, apart: bool, why: str) -> str:
    if apart:
        now = "no path joins them"
    elif math.isinf(today):
        now = f"the current path is longer than {_FAR:.0f} m"
    else:
        now = f"the current path is {today:.1f} m"
    return f"They are {length:.1f} m apart and {why}; {now}."


def _floor(v: Viewpoint) -> float:
    return v.position[2] - v.height


def _edge_length(graph: NavGraph, key: EdgeKey) -> float:
    return math.dist(graph.viewpoints[key[0]].position, graph.viewpoints[key[1]].position)
