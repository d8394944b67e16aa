"""Viewpoints where the trajectory or known floor has none near: dead ends, narrow rooms, what lies behind doors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Viewpoint
from nvsim.mapping.criteria import can_stand
from nvsim.mapping.graph_builder import apart
from nvsim.mapping.survey import Survey

_LINKS = 6  # viewpoints, the nearest first, that one of them must be joined to
_SPACING = 0.3  # metres between the places that are tried
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
        for place in np.concatenate([self._walk.places, beside]):
            seen = self._seen(place)
            if seen and apart(seen[0], place[:2]) < self._config.cover_distance:
                continue
            missed.append(place)
            yield from self._stand(place, seen)
        for place in missed:
            tries = 0
            near = np.hypot(*(beside[:, :2] - place[:2]).T) < self._config.cover_distance
            for halfway in beside[near]:
                if tries == _HALFWAY or self._is_covered(place):
                    break
                seen = self._seen(halfway)
                if not seen or apart(seen[0], halfway[:2]) < self._config.merge_radius:
                    continue
                if self._walk.in_line(halfway, place):
                    tries += 1
                    yield from self._stand(halfway, seen)

    def _is_covered(self, place: NDArray[np.floating]) -> bool:
        seen = self._seen(place)
        return bool(seen) and apart(seen[0], place[:2]) < self._config.cover_distance

    def _seen(self, place: NDArray[np.floating]) -> list[Viewpoint]:
        """Viewpoints a step away that known floor leads straight to, the nearest first."""
        near = self._draft.near(place, self._config.tau_dist)
        return [v for v in near if self._walk.in_line(np.array(v.position), place)]

    def _stand(self, place: NDArray[np.floating], seen: list[Viewpoint]) -> Iterator[tuple[Viewpoint, list[Viewpoint]]]:
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
