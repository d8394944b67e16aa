"""Colours of the graph that stand for something, and their legend."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

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
        count = len(graph.neighbors(id))
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


def test_the_evidence_has_three_groups_of_about_equal_size(document: Document, monkeypatch) -> None:
    rng = np.random.default_rng(0)
    margins = {key: float(value) for key, value in zip(document.graph.edges, rng.uniform(0.1, 0.13, 1000))}
    failing, unmeasured, *others = margins
    margins |= {failing: -0.2, unmeasured: float("nan")}
    monkeypatch.setattr(
        "nvsim_app.state.graph_coloring.smallest_margin", lambda config: lambda graph, key: margins[key]
    )
    found = coloring(document, "evidence")
    groups = {key: found.groups[group].words for key, group in found.edges.items()}
    assert groups[failing] == "fails" and groups[unmeasured] == "none"
    counts = Counter(groups[key] for key in others)
    assert len(counts) == 3 and max(counts.values()) - min(counts.values()) <= 2, "fixed limits would make one group"
    for key in others:
        words = groups[key].removeprefix("passes by ").split()
        assert float(words[0]) - 1e-3 <= margins[key]
        assert words[1] == "or" or margins[key] <= float(words[2]) + 1e-3
    monkeypatch.setattr("nvsim_app.state.graph_coloring.smallest_margin", lambda config: lambda graph, key: -1.0)
    document.editing.run("remove_edges", {"pairs": [list(failing)]})
    assert {found.groups[g].words for found in [coloring(document, "evidence")] for g in found.edges.values()} == {
        "fails"
    }


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
    assert sum(pixel in colors for pixel in seen) > 0.9 * len(seen)
    window.close()
    assert make_window(document).part(ColoringPart).by == "degree"


@pytest.mark.parametrize("size", [(800, 500), (960, 540), (1280, 720), (1600, 1000)])
@pytest.mark.parametrize("by", ["component", "evidence"])
def test_the_legend_is_below_the_map_and_covers_no_viewpoint(
    window: MainWindow, document: Document, qtbot: QtBot, size: tuple[int, int], by: str
) -> None:
    window.resize(*size)
    surface, view = window.modes.canvases[1].surface, window.panels["map"]
    qtbot.waitUntil(lambda: window.width() == size[0])
    before = view.plot.height()
    window.actions_table[f"color_{by}"].trigger()
    qtbot.waitUntil(lambda: view.legend.isVisible() and view.plot.height() < before)

    def whole() -> bool:
        entries = [entry for entry in view.legend.children() if isinstance(entry, QWidget) and entry.isVisible()]
        return len(entries) > 1 and all(view.legend.rect().contains(entry.geometry()) for entry in entries)

    qtbot.waitUntil(whole)
    document.editing.run("remove_edges", {"pairs": [list(key) for key in list(document.graph.edges)[:30]]})
    qtbot.waitUntil(lambda: not window.part(ColoringPart)._legend.is_outdated)
    qtbot.wait(50)
    assert whole(), "an entry is cut off after an edit"
    assert view.legend.height() < 0.4 * view.height()
    assert not view.legend.geometry().intersects(view.plot.geometry())
    pixels, _ = surface.project(document.graph_arrays.feet)
    assert all(surface.widget.rect().contains(*np.round(p).astype(int).tolist()) for p in pixels)
    for corner in (view.frame.coordinates, view.frame.north, view.frame.whole):
        assert corner.parentWidget() is view.plot, "the marks in the corners move with the map"


def test_the_legend_is_that_of_the_graph_on_screen(window: MainWindow, document: Document, qtbot: QtBot) -> None:
    window.actions_table["color_reviewed"].trigger()
    legend = window.panels["map"].legend
    count = len(document.graph.viewpoints)
    assert legend.accessibleDescription() == f"not reviewed  ({count})"
    window.modes.canvases[1].surface.widget.setFocus()
    document.editing.run("mark_reviewed", {"viewpoints": [next(iter(document.graph.viewpoints))], "edges": []})
    expected = f"not reviewed  ({count - 1}), reviewed  (1)"
    qtbot.waitUntil(lambda: legend.accessibleDescription() == expected)
    qtbot.keyClick(window.modes.canvases[1].surface.widget, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(lambda: legend.accessibleDescription() == f"not reviewed  ({count})")
    window.actions_table["color_plain"].trigger()
    assert legend.isHidden()


def test_a_large_graph_is_not_drawn_anew_while_it_and_the_view_stay(
    window: MainWindow, document: Document, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cached picture equals a new drawing, and only its own item draws the plain graph."""
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
