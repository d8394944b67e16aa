"""Which edge a person should look at next: the least certain one that nobody reviewed. Knows no Qt."""

from __future__ import annotations

import numpy as np

from nvsim.graph.quantities import quantity
from nvsim.graph.types import EdgeKey, NavGraph


def to_review(graph: NavGraph) -> list[EdgeKey]:
    """Edges that were not reviewed, the least certain first: those that evidence speaks least for, then what a person
    or a file put there without any evidence, the longest of these first."""
    keys, evidence = quantity(graph, "evidence", kind="edges")
    _, lengths = quantity(graph, "length", kind="edges")
    order = np.lexsort((-lengths, np.where(np.isnan(evidence), 0.5, evidence)))
    return [keys[i] for i in order.tolist() if not graph.edges[keys[i]].reviewed]
