"""The progress of a build: how much of the trajectory is done. It never decreases."""

from __future__ import annotations

from collections.abc import Callable, Set

import numpy as np
from numpy.typing import NDArray

from nvsim.mapping.graph_builder import GraphBuilder


class Covered:
    """The positions of the trajectory that are done. A position is done if it is covered and a viewpoint near it was
    expanded. It is also done if a search that began there found no room. Positions stay done."""

    def __init__(
        self,
        places: NDArray[np.float64],  # (N, 3) meters
        draft: GraphBuilder,
        reach: float,  # maximum meters at which a viewpoint covers a position
        is_covered: Callable[[NDArray[np.float64]], bool],
    ) -> None:
        self._places, self._draft, self._reach, self._is_covered = places, draft, reach, is_covered
        self._left = np.arange(len(places))
        self._asked: set[str] = set()

    @property
    def left(self) -> int:
        """Number of positions that are not done."""
        return len(self._left)

    def give_up(self, place: int) -> None:
        """Count a position as done at which no search could begin."""
        self._left = self._left[self._left != place]

    def look(self, expanded: Set[str]) -> None:
        """Count the positions that the viewpoints `expanded` cover. Every viewpoint is examined once."""
        for id in expanded - self._asked:
            viewpoint = self._draft.viewpoints.get(id)
            if viewpoint is None or not len(self._left):
                continue
            away = np.linalg.norm(self._places[self._left, :2] - viewpoint.position[:2], axis=1)
            near = self._left[away <= self._reach]
            gone = [i for i in near.tolist() if self._is_covered(self._places[i])]
            self._left = self._left[~np.isin(self._left, gone)]
        self._asked |= expanded
