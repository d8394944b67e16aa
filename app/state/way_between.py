"""Explains why two viewpoints have an edge or not, with the data of the open document."""

from __future__ import annotations

from app.state.document import Document
from nvsim.mapping.explanation.between import Between, between


def way_between(document: Document, a: str, b: str) -> Between | None:
    """The explanation for two viewpoints; None if they are equal or one does not exist. The occupancy map is used only
    if the building has one storey."""
    graph, contents = document.graph, document.contents
    if graph is None or a == b or not {a, b} <= graph.viewpoints.keys():
        return None
    occupancy = contents.occupancy if len(document.storeys.found) < 2 else None
    return between(graph, a, b, contents.thresholds, occupancy)
