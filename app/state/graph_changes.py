"""Where the last edits changed the drawing of the graph, so that a view draws only that anew."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from weakref import ReferenceType, ref

import numpy as np
from numpy.typing import NDArray

from app.state.graph_arrays import GraphArrays
from nvsim.graph.difference import Difference

STEPS = 16  # that a view may lag behind
MOST = 2000  # viewpoints of an edit; of more everything is drawn anew


class GraphChanges:
    """Says of the document's arrays what changed since some that were drawn."""

    def __init__(self) -> None:
        self._steps: deque[tuple[ReferenceType[GraphArrays], NDArray[np.float64] | None]] = deque(maxlen=STEPS)

    def forget(self) -> None:
        """The arrays are others altogether."""
        self._steps.clear()

    def note(self, before: GraphArrays, after: GraphArrays, change: Difference) -> None:
        """An edit made `after` of `before`, which were the latest."""
        ids = (*change.added_viewpoints, *change.removed_viewpoints, *change.changed_viewpoints)
        keys = (*change.added_edges, *change.removed_edges, *change.changed_edges)
        places = None
        if len(ids) + len(keys) <= MOST:
            places = np.concatenate([_places(before, ids, keys), _places(after, ids, keys)])
        self._steps.append((ref(before), places))

    def since(self, drawn: object) -> NDArray[np.float64] | None:
        """(K, 2, 3) metres, world: edges, and viewpoints as edges of no length, that come, go or move from the arrays
        `drawn` to the latest, on the floor; None when that is not known."""
        found: list[NDArray[np.float64]] = []
        for before, places in reversed(self._steps):
            if places is None:
                return None
            found.append(places)
            if before() is drawn:
                return np.concatenate(found)
        return None


def _places(
    arrays: GraphArrays, ids: Iterable[str], keys: Iterable[tuple[str, str]]
) -> NDArray[np.float64]:  # fmt: skip
    rows = arrays.viewpoint_rows(ids)
    touched = np.zeros(len(arrays.ids), bool)
    touched[rows] = True
    edges = arrays.edges
    among = edges[touched[edges[:, 0]] | touched[edges[:, 1]]] if len(rows) else edges[:0]
    named = edges[arrays.edge_rows(keys)]
    pairs = np.concatenate([np.stack([rows, rows], axis=1), among, named])
    return arrays.feet[pairs]
