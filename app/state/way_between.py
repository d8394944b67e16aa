"""Explains why two viewpoints have an edge or not, and where it is blocked, with the data of the open document."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.state.document import Document
from nvsim.graph.types import EdgeKey
from nvsim.mapping.criteria import OPEN
from nvsim.mapping.explanation.between import Between, between


def way_between(document: Document, a: str, b: str) -> Between | None:
    """The explanation for two viewpoints; None if they are equal or one does not exist. The occupancy map is used only
    if the building has one storey."""
    graph, contents = document.graph, document.contents
    if graph is None or a == b or not {a, b} <= graph.viewpoints.keys():
        return None
    occupancy = contents.occupancy if len(document.storeys.found) < 2 else None
    return between(graph, a, b, contents.thresholds, occupancy)


def blocking_place(document: Document, key: EdgeKey) -> NDArray[np.float64] | None:
    """(3,) meters, world: the floor at the first known obstacle on the line of an edge; None if none is known."""
    found = way_between(document, *key)
    if found is None:
        return None
    arrays = document.graph_arrays
    start, end = (arrays.feet[arrays.index[id]] for id in key)
    if found.blocked is not None:
        along = found.blocked / max(float(np.linalg.norm((end - start)[:2])), 1e-9)
        return np.asarray(start + along * (end - start))
    for way in found.ways:
        explanation = way.found
        if explanation is not None and explanation.decision != OPEN and explanation.obstacle is not None:
            begin, goal = (arrays.feet[arrays.index[id]] for id in (way.start, way.end))
            along = min(explanation.obstacle / max(found.metres, 1e-9), 1.0)
            return np.asarray(begin + along * (goal - begin))
    return None
