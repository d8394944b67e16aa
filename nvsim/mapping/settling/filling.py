"""Add viewpoints where the trajectory or known floor has none nearby: dead ends, narrow rooms, and rooms behind
doors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.graph.types import Viewpoint
from nvsim.mapping.criteria import can_stand
from nvsim.mapping.search.graph_builder import SAME, SAME_FLOOR, STEEPEST, apart
from nvsim.mapping.search.survey import Survey

_LINKS = 6  # maximum viewpoints, the nearest first, to which a new one is joined
_SPACING = 0.3  # meters between the positions that are tried
_NEAREST = 4  # number of nearest viewpoints that may cover a position, tested for all positions at once
_HALFWAY = 3  # maximum positions on the way to a position that no step reaches


class Filling:
    """Finds positions that the graph of `survey` does not cover and that have room, and measures around them."""

    def __init__(self, survey: Survey) -> None:
        self._survey, self._draft, self._walk, self._config = survey, survey.draft, survey.walk, survey.config
        self._tried: set[str] = set()

    def found(self) -> Iterator[tuple[Viewpoint, list[Viewpoint]]]:
        """Yield each new viewpoint with the viewpoints around it that it sees. It is already in the graph; the caller
        joins it or removes it.

        Positions on the trajectory come first, then known floor, beginning with the most room. Last come positions a
        shorter step away, on the way to those that no step reaches.
        """
        beside = self._walk.beside(self._config.half_width, _SPACING)
        missed = []
        places = np.concatenate([self._walk.places, beside])
        for place in places[~self._covered(places)]:
            seen = self._seen(place)
            if seen and apart(seen[0], place[:2]) < self._config.cover_distance:
                continue
            missed.append(place)
            yield from self._stand(place, seen)
        if not missed or not len(beside):
            return
        tree = cKDTree(beside[:, :2])
        for place in missed:
            tries, covered = 0, self._is_covered(place)
            around = beside[tree.query_ball_point(place[:2], self._config.cover_distance, return_sorted=True)]
            for halfway in around[np.hypot(*(around[:, :2] - place[:2]).T) < self._config.cover_distance]:
                if tries == _HALFWAY or covered:
                    break
                seen = self._seen(halfway)
                if not seen or apart(seen[0], halfway[:2]) < self._config.merge_radius:
                    continue
                if self._walk.in_line(halfway, place):
                    tries += 1
                    yield from self._stand(halfway, seen)
                    covered = self._is_covered(place)

    def _covered(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) bool: whether one of the nearest viewpoints is near and in line with each position (N, 3). All are
        tested at once, because most are covered and stay covered while viewpoints are added."""
        covered = np.zeros(len(places), bool)
        stand = np.array([v.position for v in self._draft.viewpoints.values()]).reshape(-1, 3)
        most = self._config.cover_distance - SAME
        if not len(stand) or not len(places) or most <= 0:
            return covered
        apart_by, nearest = cKDTree(stand[:, :2]).query(places[:, :2], k=_NEAREST, distance_upper_bound=most)
        for metres, which in zip(apart_by.T, nearest.T, strict=True):
            at = np.flatnonzero(np.isfinite(metres) & ~covered)
            there = stand[which[at]]
            level = np.abs(there[:, 2] - places[at, 2]) <= STEEPEST * metres[at] + SAME_FLOOR - SAME
            at, there = at[level], there[level]
            covered[at[self._walk.all_in_line(there, places[at])]] = True
        return covered

    def _is_covered(self, place: NDArray[np.floating]) -> bool:
        seen = self._seen(place)
        return bool(seen) and apart(seen[0], place[:2]) < self._config.cover_distance

    def _seen(self, place: NDArray[np.floating]) -> list[Viewpoint]:
        """Return the viewpoints within one step to which known floor leads straight, the nearest first."""
        near = self._draft.near(place, self._config.tau_dist)
        there = np.array([v.position for v in near]).reshape(-1, 3)
        found = self._walk.all_in_line(there, np.broadcast_to(place, there.shape))
        return [v for v, line in zip(near, found.tolist(), strict=True) if line]

    def _stand(self, place: NDArray[np.floating], seen: list[Viewpoint]) -> Iterator[tuple[Viewpoint, list[Viewpoint]]]:
        if not self._survey.is_level(place):
            return
        viewpoint = self._survey.viewpoint(place, "step")
        seen = [v for v in seen if self._survey.knows_floor(viewpoint, v)][:_LINKS]
        if not seen or viewpoint.id in self._tried:
            return
        self._tried.add(viewpoint.id)
        self._survey.lattice.begin(viewpoint.id, viewpoint.position[:2])
        around = self._survey.around(viewpoint)
        if can_stand(around, self._config):
            self._survey.take(viewpoint, around)
            yield viewpoint, seen
