"""Selects the shortest paths of a graph that may become tasks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.ways import Ways
from nvsim.r2r.tasks.shortest import ShortestPaths

LONGEST = 100
"""Largest number of edges in a path."""


@dataclass(frozen=True)
class Bounds:
    """Limits of paths; the defaults are those of R2R (Anderson et al. 2018, section 4.1)."""

    fewest_edges: int = 4
    """Smallest number of edges in a path."""
    most_edges: int = 6
    """Largest number of edges in a path."""
    least_metres: float = 5.0
    """Smallest length of a path in meters."""
    most_metres: float = math.inf
    """Largest length of a path in meters."""
    ties: bool = False
    """Also use paths that have an alternative at most 1 cm longer. Agents may be taught the alternative."""

    def __post_init__(self) -> None:
        if not 1 <= self.fewest_edges <= self.most_edges <= LONGEST:
            raise InputError(
                f"No path has from {self.fewest_edges} to {self.most_edges} edges; give --fewest-edges from 1 to "
                f"--most-edges, and --most-edges up to {LONGEST}."
            )
        if not 0 <= self.least_metres <= self.most_metres:
            raise InputError(
                f"No path is from {self.least_metres:g} to {self.most_metres:g} m long; give --least-metres from 0 to "
                "--most-metres."
            )


@dataclass(frozen=True, eq=False)
class Eligible:
    """The paths of a graph that may become tasks, each in one direction.

    ids      (N) viewpoint ids
    rows     (M, most_edges + 1) int64, the viewpoints of each path, -1 after its end
    metres   (M,) float64, meters
    """

    ids: tuple[str, ...]
    rows: NDArray[np.int64]
    metres: NDArray[np.float64]

    def path(self, i: int) -> tuple[int, ...]:
        return tuple(self.rows[i][self.rows[i] >= 0].tolist())

    def inside(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Returns (M,) bool: whether all viewpoints of each path are in `chosen` (N,) bool."""
        return np.asarray(np.append(chosen, True)[self.rows].all(axis=1))


def eligible_paths(ways: Ways, bounds: Bounds) -> Eligible:
    """Returns the shortest path between every two viewpoints, if it is within the bounds."""
    shortest = ShortestPaths(ways)
    most = bounds.most_edges
    found, lengths = [np.zeros((0, most + 1), np.int64)], [np.zeros(0)]
    for source in range(len(ways.ids)):
        tree = shortest.tree(source, most)
        fits = (tree.edges >= bounds.fewest_edges) & (tree.edges <= most)
        fits &= (tree.metres >= bounds.least_metres) & (tree.metres <= bounds.most_metres)
        fits[: source + 1] = False  # these pairs were tested from their other end
        if not bounds.ties and fits.any():
            fits &= ~ways.tied(source)[2]
        ends = np.flatnonzero(fits)
        rows = np.full((len(ends), most + 1), -1, np.int64)
        here = ends
        for k in range(most + 1):
            rows[:, k] = here
            here = np.where(here >= 0, tree.before[here], -1)
        found.append(rows)
        lengths.append(tree.metres[ends])
    return Eligible(ways.ids, np.concatenate(found), np.concatenate(lengths))
