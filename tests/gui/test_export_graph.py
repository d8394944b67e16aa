"""Exporting the edited graph from the window."""

from __future__ import annotations

import json
from pathlib import Path

import networkx as nx
import pytest

from app.state.document import Document
from app.wiring.exporting import ExportPart
from app.wiring.window import MainWindow


@pytest.fixture
def part(window: MainWindow) -> ExportPart:
    return next(p for p in window.parts if isinstance(p, ExportPart))


def test_every_kind_is_written_from_the_edited_graph(part: ExportPart, document: Document, tmp_path: Path) -> None:
    document.editing.run("remove_edges", {"pairs": [list(next(iter(document.graph.edges)))]})
    for kind in ("graphml", "geojson", "png", "svg"):
        assert part.export(kind, tmp_path / f"graph.{kind}")
    assert part.export("r2r", tmp_path)
    assert nx.read_graphml(tmp_path / "graph.graphml").number_of_edges() == len(document.graph.edges)
    assert len(json.loads((tmp_path / "demo_connectivity.json").read_text())) == len(document.graph.viewpoints)
    assert (tmp_path / "scans.txt").read_text() == "demo\n"
    assert (tmp_path / "graph.png").read_bytes()[:4] == b"\x89PNG" and b"<svg" in (tmp_path / "graph.svg").read_bytes()


def test_what_agents_choke_on_is_refused_with_the_reason(
    part: ExportPart, window: MainWindow, document: Document, tmp_path: Path
) -> None:
    id = document.graph_arrays.ids[0]
    document.editing.run("remove_edges", {"pairs": [list(key) for key in document.graph.edges if id in key]})
    assert not part.export("r2r", tmp_path)
    assert id[:8] in window.notice_area.texts[-1] and not list(tmp_path.glob("*.json"))
    assert part.export("r2r", tmp_path, force=True)
    assert (tmp_path / "demo_connectivity.json").is_file()
