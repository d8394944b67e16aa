"""The storeys of a building and the storey that the views show, because the map would show all storeys at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PySide6.QtCore import QObject, Signal

from nvsim.geometry.storeys import Storey, storeys
from nvsim_app.state.graph_arrays import GraphArrays


class Storeys(QObject):
    """The storeys of the graph. changed(): the storeys changed, or another one is displayed."""

    changed = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.found: tuple[Storey, ...] = ()
        self.chosen: int | None = None
        """Index in `found` of the displayed storey; None displays all."""
        self.others_faded = True
        """Whether the other storeys are drawn faintly."""
        self._of: GraphArrays | None = None
        self._beside: tuple[object, object, GraphArrays] = (None, None, GraphArrays())
        self._shown = GraphArrays()

    def look(self, arrays: GraphArrays, *, anew: bool = False) -> None:
        """Updates the storeys after a change of the graph. The displayed storey is kept if there is still one at its
        height, unless `anew`."""
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
        """The minimum and maximum height of the displayed storey in meters, world; None if all are displayed."""
        storey = self.storey
        return None if storey is None else (storey.low, storey.high)

    def choose(self, index: int | None) -> None:
        """Displays one storey; None displays all."""
        if index != self.chosen and (index is None or 0 <= index < len(self.found)):
            self.chosen, self._of = index, None
            self.changed.emit()

    def step(self, by: int) -> None:
        """Moves up or down by storeys. If all are displayed, starts at the lowest or the highest."""
        first = 0 if by > 0 else len(self.found) - 1
        self.choose(first if self.chosen is None else min(max(self.chosen + by, 0), len(self.found) - 1))

    def follow(self, arrays: GraphArrays, ids: frozenset[str]) -> None:
        """Displays the storey of the selected viewpoints `ids` if none of them is displayed. If they are on several
        storeys, displays all."""
        if self.chosen is None or not ids:
            return
        floors = arrays.feet[arrays.viewpoint_rows(ids), 2]
        if len(floors) and not self.found[self.chosen].holds(floors).any():
            holding = [i for i, s in enumerate(self.found) if s.holds(floors).all()]
            self.choose(holding[0] if holding else None)

    def shown(self, arrays: GraphArrays) -> GraphArrays:
        """The displayed part of `arrays`; `arrays` itself if all storeys are displayed."""
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
        """The part of `arrays` that is drawn faintly and cannot be picked with the mouse."""
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
