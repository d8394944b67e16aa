"""`nvsim bench graph` measures an edit with its painting, where there is a window to paint in."""

from __future__ import annotations

import json

import pytest
from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QApplication

from nvsim.benchmarks import graph
from nvsim.cli.commands import bench_window
from nvsim.cli.main import main
from nvsim_app.benchmarks import graphs
from nvsim_app.wiring.window import MainWindow


def test_edits_are_painted_and_the_lists_follow(
    qapp: QApplication, settings: QSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(graphs, "SETTLE", 0.1)
    figures = graphs.measure(settings, edits=6, viewpoints=120)
    assert set(figures) == {
        "paint_p95_ms", "paint_median_ms", "painted_edit_p95_ms",
        "lists_paint_p95_ms", "lists_turn_p95_ms", "lists_turn_max_ms",
        "findings_first_ms", "findings_p95_ms", "findings_max_ms",
    }  # fmt: skip
    assert all(value > 0 for value in figures.values())
    assert figures["paint_p95_ms"] > figures["painted_edit_p95_ms"]
    assert figures["findings_p95_ms"] >= figures["lists_paint_p95_ms"]


def test_both_views_of_a_graph_are_panned_and_pointed_at(window: MainWindow, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(graphs, "SECONDS", 0.05)
    figures: dict[str, float | str | None] = {}
    list(graphs.graph_views(window, figures))
    assert set(figures) == {"scene_pan_fps", "scene_hover_fps", "map_pan_fps", "map_zoom_fps", "map_hover_fps"}


@pytest.mark.parametrize("qt", [True, False])
def test_the_command_asks_a_window_where_there_is_qt(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], qt: bool
) -> None:
    known = {"edit_p95_ms": 4.0, "open_s": 0.1, "save_s": 0.1, "select_delete_undo_ms": 40.0}
    asked: list[list[str]] = []
    monkeypatch.setattr(graph, "measure", lambda edits, viewpoints: dict(known))
    monkeypatch.setattr(bench_window, "is_window_installed", lambda: qt)
    monkeypatch.setattr(bench_window, "measured_by_window", lambda given: asked.append(given) or {"paint_p95_ms": 20.0})
    assert main(["bench", "graph", "--json", "--edits", "7"]) == 0
    expected = known | ({"paint_p95_ms": 20.0} if qt else {})
    assert json.loads(capsys.readouterr().out) == expected
    assert asked == ([["--bench-edits=7", "--viewpoints=10000"]] if qt else [])
