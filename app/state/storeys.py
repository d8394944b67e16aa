"""Which storey of a building the views show: of a graph with several floors the plan would show all at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PySide6.QtCore import QObject, Signal

from app.state.graph_arrays import GraphArrays
from nvsim.geometry.storeys import Storey, storeys


class Storeys(QObject):
    """changed(): there are other storeys, or another one is shown."""

    changed = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.found: tuple[Storey, ...] = ()
        self.chosen: int | None = None
        """Which of `found` is shown; None: all."""
        self.others_faded = True
        """Whether the other storeys are drawn faintly beside the one that is shown."""
        self._of: GraphArrays | None = None
        self._beside: tuple[object, object, GraphArrays] = (None, None, GraphArrays())
        self._shown = GraphArrays()

    def look(self, arrays: GraphArrays, *, anew: bool = False) -> None:
        """The graph is another: the storey shown stays where there still is one at its height, unless `anew`."""
        before, was = self.storey, (self.found, self.chosen)
        self.found = storeys(arrays.feet[:, 2])
        near = [i for i, s in enumerate(self.found) if before is not None and abs(s.floor - before.floor) < 1.0]
        self.chosen = near[0] if near and not anew and len(self.found) > 1 else None
        if self.storey != before:
            self._of = None
        if (self.found, self.chosen) != was:
            self.changed.emit()

    @property
    def storey(self) -> Storey | None:
        return None if self.chosen is None else self.found[self.chosen]

    @property
    def between(self) -> tuple[float, float] | None:
        """The heights between which what is shown stands; None where everything is."""
        storey = self.storey
        return None if storey is None else (storey.low, storey.high)

    def choose(self, index: int | None) -> None:
        """Shows one storey, or all."""
        if index != self.chosen and (index is None or 0 <= index < len(self.found)):
            self.chosen, self._of = index, None
            self.changed.emit()

    def step(self, by: int) -> None:
        """Goes up or down; from all storeys to the lowest or the highest."""
        first = 0 if by > 0 else len(self.found) - 1
        self.choose(first if self.chosen is None else min(max(self.chosen + by, 0), len(self.found) - 1))

    def follow(self, arrays: GraphArrays, ids: frozenset[str]) -> None:
        """Something was selected: where none of it is shown, its storey is; all storeys when it lies in several."""
        if self.chosen is None or not ids:
            return
        floors = arrays.feet[arrays.viewpoint_rows(ids), 2]
        if len(floors) and not self.found[self.chosen].holds(floors).any():
            holding = [i for i, s in enumerate(self.found) if s.holds(floors).all()]
            self.choose(holding[0] if holding else None)

    def shown(self, arrays: GraphArrays) -> GraphArrays:
        """Those of `arrays` that are shown: the same object where all are."""
        storey = self.storey
        if storey is None:
            return arrays
        if self._of is not arrays:
            self._of, self._shown = arrays, _kept(arrays, storey.holds(arrays.feet[:, 2]))
        return self._shown

    def fade_others(self, on: bool) -> None:
        if on != self.others_faded:
            self.others_faded = on
            self.changed.emit()

    def others(self, arrays: GraphArrays) -> GraphArrays:
        """Those of `arrays` that are not shown and drawn faintly; the mouse does not meet them."""
        storey = self.storey
        if storey is None or not self.others_faded:
            return GraphArrays()
        if self._beside[0] is not arrays or self._beside[1] is not storey:
            self._beside = arrays, storey, _kept(arrays, ~storey.holds(arrays.feet[:, 2]))
        return self._beside[2]


def _kept(arrays: GraphArrays, keep: np.ndarray) -> GraphArrays:
    rows = np.flatnonzero(keep)
    ids = tuple(arrays.ids[row] for row in rows)
    moved_to = np.cumsum(keep) - 1
    return replace(
        arrays,
        ids=ids,
        positions=arrays.positions[rows],
        feet=arrays.feet[rows],
        edges=moved_to[arrays.edges[keep[arrays.edges].all(axis=1)]],
        submaps=arrays.submaps[rows],
        included=arrays.included[rows],
        index={id: i for i, id in enumerate(ids)},
    )
