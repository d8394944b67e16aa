"""Colours of the graph that stand for something, and their legend."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtGui import QColor

from nvsim.benchmarks.graph import random_graph
from nvsim.graph import edits
from nvsim.graph.edits import EditError
from nvsim.graph.paths import components
from nvsim_app.state.document import Document
from nvsim_app.state.graph_coloring import coloring
from nvsim_app.wiring.display import ColoringPart
from nvsim_app.wiring.window import MainWindow


def test_the_groups_are_those_of_the_quantities(document: Document) -> None:
    graph = document.graph
    assert graph is not None
    degrees = coloring(document, "degree")
    lonely = next(iter(graph.viewpoints))
    words = {id: degrees.groups[group].words for id, group in degrees.viewpoints.items()}
    for id in graph.viewpoints:
        count = len(graph.neighbours(id))
        assert words[id] == ("none", "1", "2", "3", "4 or 5", "4 or 5", "6 or more")[min(count, 6)]
    cut = edits.remove_edges(graph, [key for key in graph.edges if lonely in key])
    document.set_contents(replace(document.contents, graph=cut))
    parts = coloring(document, "component")
    assert len(parts.groups) == len(components(document.graph)) >= 2
    assert parts.counts.sum() == len(graph.viewpoints)
    evidence = coloring(document, "evidence")
    assert {evidence.groups[g].words for g in evidence.edges.values()} <= {g.words for g in evidence.groups}
    assert set(evidence.edges) == set(document.graph.edges)


def test_the_photographed_share_is_compared_with_the_threshold_of_the_map(document: Document) -> None:
    graph, least = document.graph, document.contents.thresholds.photographed
    shares = [least - 0.01, least, 0.99, None]
    ids = list(graph.viewpoints)[: len(shares)]
    given = {id: replace(graph.viewpoints[id], photographed=share) for id, share in zip(ids, shares, strict=True)}
    document.set_contents(replace(document.contents, graph=replace(graph, viewpoints={**graph.viewpoints, **given})))
    found = coloring(document, "photographed")
    assert [found.viewpoints[id] for id in ids] == [0, 1, 2, 3]
    assert not found.edges and found.groups[0].words == f"below {least:.0%}"


def test_validity_needs_a_map(document: Document) -> None:
    on_map = coloring(document, "validity")
    assert set(on_map.viewpoints.values()) == {1}, "every viewpoint of the room stands on free floor"
    document.set_contents(replace(document.contents, occupancy=None))
    with pytest.raises(EditError, match="occupancy map"):
        coloring(document, "validity")


def test_the_map_shows_them_with_a_legend_and_the_next_window_too(
    window: MainWindow, document: Document, make_window
) -> None:
    view = window.modes.canvases[1].surface.widget
    before = view.grab().toImage()
    window.actions_table["color_degree"].trigger()
    after = view.grab().toImage()
    assert before != after
    part = window.part(ColoringPart)
    colors = {QColor(group.color).rgb() for group in part.coloring.groups}
    ratio = after.devicePixelRatio()
    pixels, _ = window.modes.canvases[1].surface.project(document.graph_arrays.feet)
    seen = [after.pixelColor(*(np.round(p * ratio).astype(int).tolist())).rgb() for p in pixels]
    assert sum(pixel in colors for pixel in seen) > 0.7 * len(seen)  # the legend covers some viewpoints
    window.close()
    assert make_window(document).part(ColoringPart).by == "degree"


def test_a_large_graph_is_not_drawn_anew_while_it_and_the_view_stay(
    window: MainWindow, document: Document, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is kept is what would be drawn; the plain graph is drawn by nobody but its own item."""
    document.set_contents(replace(document.contents, graph=random_graph(1500), occupancy=None))
    part, view = window.part(ColoringPart), window.modes.canvases[1].surface.widget
    drawn: list[object] = []
    draw = part._draw
    monkeypatch.setattr(part, "_draw", lambda *arguments: (drawn.append(arguments[0]), draw(*arguments)))
    view.grab()
    assert not drawn and not part._kept, "one colour: its own item keeps the drawing"
    window.actions_table["color_degree"].trigger()
    pictures = [view.grab().toImage() for _ in range(4)]
    count = len(drawn)
    assert count <= 3 and pictures[3] == view.grab().toImage() and len(drawn) == count
    apart = [
        abs(int(v) - int(w)) for a, b in [(pictures[0], pictures[3])] for v, w in zip(a.constBits(), b.constBits())
    ]
    assert np.mean(apart) < 1, "kept or painted directly, it looks the same"
    document.editing.run("remove_edges", {"pairs": [list(key) for key in list(document.graph.edges)[:3000]]})
    assert view.grab().toImage() != pictures[3] and len(drawn) > count
    count, moved = len(drawn), view.grab().toImage()
    window.modes.canvases[1].surface._view.plot.getViewBox().scaleBy((0.5, 0.5))
    assert view.grab().toImage() != moved and len(drawn) > count
