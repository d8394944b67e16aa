"""Viewpoints where the trajectory or known floor has none near: dead ends, narrow rooms, what lies behind doors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.graph.types import Viewpoint
from nvsim.mapping.criteria import can_stand
from nvsim.mapping.graph_builder import SAME, SAME_FLOOR, STEEPEST, apart
from nvsim.mapping.survey import Survey

_LINKS = 6  # viewpoints, the nearest first, that one of them must be joined to
_SPACING = 0.3  # metres between the places that are tried
_NEAREST = 4  # viewpoints that are asked whether they cover a place, for all places at once
_HALFWAY = 3  # places on the way to one that cannot be stepped to, at most


class Filling:
    """Finds places to stand that the graph of `survey` leaves uncovered, and looks around there."""

    def __init__(self, survey: Survey) -> None:
        self._survey, self._draft, self._walk, self._config = survey, survey.draft, survey.walk, survey.config
        self._tried: set[str] = set()

    def found(self) -> Iterator[tuple[Viewpoint, list[Viewpoint]]]:
        """One viewpoint after the other, put into the graph, with those around that it sees; the caller joins it, or
        removes it. Places of the trajectory come first, then known floor, that with the most room first; last, places
        a shorter step away, on the way to those that no step leads to."""
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
        """(N,) whether one of the nearest viewpoints is near and in line with each place (N, 3), for all at once: most
        are, and stay so while viewpoints are added."""
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
        """Viewpoints a step away that known floor leads straight to, the nearest first."""
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
