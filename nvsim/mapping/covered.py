"""How much of the trajectory a build has dealt with: its progress, which never goes back."""

from __future__ import annotations

from collections.abc import Callable, Set

import numpy as np
from numpy.typing import NDArray

from nvsim.mapping.graph_builder import GraphBuilder


class Covered:
    """The places of the trajectory that a search reached. A place counts once it is covered where a viewpoint near it
    was looked around from, or once a search that began there found nowhere to stand; it counts for good."""

    def __init__(
        self,
        places: NDArray[np.float64],  # (N, 3) metres
        draft: GraphBuilder,
        reach: float,  # metres at which a viewpoint covers at most
        is_covered: Callable[[NDArray[np.float64]], bool],
    ) -> None:
        self._places, self._draft, self._reach, self._is_covered = places, draft, reach, is_covered
        self._left = np.arange(len(places))
        self._asked: set[str] = set()

    @property
    def left(self) -> int:
        """Places that no search reached yet."""
        return len(self._left)

    def give_up(self, place: int) -> None:
        """Counts a place at which no search could begin."""
        self._left = self._left[self._left != place]

    def look(self, expanded: Set[str]) -> None:
        """Counts what the viewpoints `expanded` cover that were not asked before."""
        for id in expanded - self._asked:
            viewpoint = self._draft.viewpoints.get(id)
            if viewpoint is None or not len(self._left):
                continue
            away = np.linalg.norm(self._places[self._left, :2] - viewpoint.position[:2], axis=1)
            near = self._left[away <= self._reach]
            gone = [i for i in near.tolist() if self._is_covered(self._places[i])]
            self._left = self._left[~np.isin(self._left, gone)]
        self._asked |= expanded
