"""Records where the last edits changed the drawing of the graph, so that views repaint only these parts."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from weakref import ReferenceType, ref

import numpy as np
from numpy.typing import NDArray

from app.state.graph_arrays import GraphArrays
from nvsim.graph.difference import Difference

STEPS = 16  # number of recorded edits
MOST = 2000  # maximum number of viewpoints and edges of an edit; after a larger edit, everything is repainted


class GraphChanges:
    """The changes of the document's graph arrays between a drawn version and the latest one."""

    def __init__(self) -> None:
        self._steps: deque[tuple[ReferenceType[GraphArrays], NDArray[np.float64] | None]] = deque(maxlen=STEPS)

    def forget(self) -> None:
        """Discards all changes, because another graph was opened."""
        self._steps.clear()

    def note(self, before: GraphArrays, after: GraphArrays, change: Difference) -> None:
        """Records an edit that changed the latest arrays `before` to `after`."""
        ids = (*change.added_viewpoints, *change.removed_viewpoints, *change.changed_viewpoints)
        keys = (*change.added_edges, *change.removed_edges, *change.changed_edges)
        places = None
        if len(ids) + len(keys) <= MOST:
            places = np.concatenate([_places(before, ids, keys), _places(after, ids, keys)])
        self._steps.append((ref(before), places))

    def since(self, drawn: object) -> NDArray[np.float64] | None:
        """(K, 2, 3) meters, world: the floor segments of added, removed, and moved edges since the arrays `drawn`.
        Viewpoints are segments of length 0. None if the changes are not known."""
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
