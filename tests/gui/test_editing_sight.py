"""Edits that ask who sees whom, in the window: on the occupancy map of the project."""

from __future__ import annotations

import numpy as np

from nvsim.occupancy.types import FREE
from nvsim_app.state.document import Document


def test_connecting_what_sees_each_other_adds_no_edge_through_the_furniture(document: Document) -> None:
    graph, occupancy = document.graph, document.contents.occupancy
    assert graph is not None and occupancy is not None
    assert document.editing.run("connect_visible", {"distance": 3.0})
    after = document.graph
    assert after is not None
    new = [key for key in after.edges if key not in graph.edges]
    assert new
    for a, b in new:
        ends = [after.viewpoints[id].position for id in (a, b)]
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            place = np.array([p + share * (q - p) for p, q in zip(*ends, strict=True)])
            assert occupancy.states_at(place[:2]) == FREE
