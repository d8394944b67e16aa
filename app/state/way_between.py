"""Why there is an edge between two viewpoints, or none, by what the open document knows."""

from __future__ import annotations

from app.state.document import Document
from nvsim.mapping.between import Between, between


def way_between(document: Document, a: str, b: str) -> Between | None:
    """None where one of them is no viewpoint. A map is asked where the building has one storey, which it shows."""
    graph, contents = document.graph, document.contents
    if graph is None or a == b or not {a, b} <= graph.viewpoints.keys():
        return None
    occupancy = contents.occupancy if len(document.storeys.found) < 2 else None
    return between(graph, a, b, contents.thresholds, occupancy)
