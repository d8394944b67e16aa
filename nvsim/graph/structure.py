"""The structure of a graph in figures that need no map: degrees, lengths, clustering, and ties of shortest paths."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.paths import PathGraph
from nvsim.graph.types import NavGraph

EXACT = 500
"""Up to this many viewpoints, all pairs are evaluated. In larger graphs, only the paths from this many viewpoints
are."""
_EPISODE = (4, 6, 5.0)  # minimum and maximum edges, minimum meters of an R2R path (Anderson et al. 2018, section 4.1)


def structure(graphs: NavGraph | Iterable[NavGraph]) -> dict[str, float | int]:
    """Return figures over the included viewpoints and the edges between them, of one graph or pooled over several.

    mean_degree, degree_p5, degree_p95                              edges of a viewpoint: mean, 5 and 95 %
    edge_length, edge_length_p5, edge_length_p95, edge_length_max   meters: mean, 5 and 95 %, maximum
    nearest, nearest_mean       meters to the nearest other viewpoint: median, mean
    clustering                  mean local clustering coefficient (Watts and Strogatz 1998); 0 for fewer than two edges
    tied                        share of all connected pairs, neighbors included, with a second shortest path that is at
                                most 1 cm longer
    tied_episodes               this share of the pairs that R2R uses for episodes: 4 to 6 edges and at least 5 m. The
                                share of all pairs grows with the size of a building; this share does not.

    Figures without data are 0. For more than EXACT viewpoints, ties are those of the paths from EXACT of them.
    """
    import networkx as nx

    degrees, lengths, nearest, clustering = [], [], [], []
    tied = episodes = np.zeros(2, np.int64)
    for graph in [graphs] if isinstance(graphs, NavGraph) else graphs:
        ways = PathGraph.of(graph)
        degrees.append(np.bincount(ways.ends.ravel(), minlength=len(ways.ids)).astype(np.float64))
        lengths.append(ways.length)
        nearest.append(_nearest(ways.places))
        joined = nx.Graph()
        joined.add_nodes_from(range(len(ways.ids)))
        joined.add_edges_from(ways.ends.tolist())
        clustering.append(np.array(list(nx.clustering(joined).values()), np.float64))
        of_all, of_episodes = _count_ties(ways)
        tied, episodes = tied + of_all, episodes + of_episodes
    degree, length, apart, local = (_join_lengths(parts) for parts in (degrees, lengths, nearest, clustering))
    return {
        "mean_degree": _mean(degree, 2),
        "degree_p5": _percentile(degree, 5),
        "degree_p95": _percentile(degree, 95),
        "edge_length": _mean(length),
        "edge_length_p5": _percentile(length, 5),
        "edge_length_p95": _percentile(length, 95),
        "edge_length_max": _percentile(length, 100),
        "nearest": _percentile(apart, 50),
        "nearest_mean": _mean(apart),
        "clustering": _mean(local),
        "tied": round(float(tied[0] / max(tied[1], 1)), 5),
        "tied_episodes": round(float(episodes[0] / max(episodes[1], 1)), 5),
    }


def evenly_spaced_rows(count: int, most: int) -> NDArray[np.int64]:
    """Return (M,) int64, at most `most` of the rows 0 to `count` - 1 in order. The choice is equal in every run."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, most, replace=False))


def _count_ties(ways: PathGraph) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (2,) the numbers of tied and of all pairs, and (2,) these numbers for pairs that make episodes."""
    tied, episodes = np.zeros(2, np.int64), np.zeros(2, np.int64)
    fewest, most, least = _EPISODE
    for source in evenly_spaced_rows(len(ways.ids), EXACT).tolist():
        far, edges, second = ways.shortest_paths_with_ties(source)
        pairs = np.isfinite(far) & (edges > 0)
        tied += (int((second & pairs).sum()), int(pairs.sum()))
        pairs &= (edges >= fewest) & (edges <= most) & (far >= least)
        episodes += (int((second & pairs).sum()), int(pairs.sum()))
    return tied, episodes


def _nearest(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) meters to the nearest other viewpoint; empty for a single viewpoint."""
    from scipy.spatial import cKDTree

    if len(places) < 2:
        return np.zeros(0)
    return np.asarray(cKDTree(places).query(places, 2)[0][:, 1])


def _join_lengths(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.concatenate(parts) if parts else np.zeros(0)


def _percentile(values: NDArray[np.float64], percent: float) -> float:
    return round(float(np.percentile(values, percent)), 3) if len(values) else 0.0


def _mean(values: NDArray[np.float64], digits: int = 3) -> float:
    return round(float(values.mean()), digits) if len(values) else 0.0
