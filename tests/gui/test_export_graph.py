"""Exporting the edited graph from the window."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import networkx as nx
import pytest

from nvsim_app.state.document import Document
from nvsim_app.wiring.display import ColoringPart
from nvsim_app.wiring.exporting import ExportPart, draw_figure
from nvsim_app.wiring.window import MainWindow

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def part(window: MainWindow) -> ExportPart:
    return window.part(ExportPart)


def test_every_kind_is_written_from_the_edited_graph(part: ExportPart, document: Document, tmp_path: Path) -> None:
    document.editing.run("remove_edges", {"pairs": [list(next(iter(document.graph.edges)))]})
    for kind in ("graphml", "geojson", "png", "svg"):
        assert part.export(kind, tmp_path / f"graph.{kind}")
    assert part.export("r2r", tmp_path)
    assert nx.read_graphml(tmp_path / "graph.graphml").number_of_edges() == len(document.graph.edges)
    assert len(json.loads((tmp_path / "demo_connectivity.json").read_text())) == len(document.graph.viewpoints)
    assert (tmp_path / "scans.txt").read_text() == "demo\n"
    assert part.export("pdf", tmp_path / "graph.pdf") and (tmp_path / "graph.pdf").read_bytes()[:5] == b"%PDF-"
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


def test_a_figure_takes_what_is_colored_now_and_its_legend(
    part: ExportPart, window: MainWindow, document: Document, tmp_path: Path
) -> None:
    assert part.export("svg", tmp_path / "plain.svg")
    window.actions_table["color_degree"].trigger()
    window.preferences.set("units", "feet")
    assert part.export("svg", tmp_path / "coloured.svg") and part.export("png", tmp_path / "coloured.png")
    window.preferences.set("units", "metres")
    plain, colored = (ET.parse(tmp_path / f"{name}.svg").getroot() for name in ("plain", "coloured"))
    words = [[each.text for each in root.iter(f"{SVG}text")] for root in (plain, colored)]
    found = window.part(ColoringPart).coloring
    counted = [f"{g.words} ({n:,})" for g, n in zip(found.groups, found.counts.tolist(), strict=True) if n]
    assert words[1][0].endswith(" ft") and words[1][1:] == ["Neighbors", *counted]
    assert words[0][0].endswith(" m") and not set(counted) & set(words[0])
    dots = [each for each in colored.iter(f"{SVG}use") if "fill: #" in each.get("style", "")]
    fills = {re.search("fill: (#[0-9a-f]+)", each.get("style"))[1] for each in dots}
    assert {found.groups[n].color for n in found.viewpoints.values()} <= fills
    assert len({each.get("{http://www.w3.org/1999/xlink}href") for each in dots}) > 1, "shapes say it without colour"


def test_a_pdf_is_one_page_as_large_as_the_figure(part: ExportPart, document: Document, tmp_path: Path) -> None:
    assert part.export("pdf", tmp_path / "graph.pdf")
    data = (tmp_path / "graph.pdf").read_bytes()
    (box,) = re.findall(rb"/MediaBox \[([\d. ]+)\]", data)
    _, _, width, height = (float(side) for side in box.split())
    wide, high = draw_figure(document.graph, document.contents.occupancy, None).get_size_inches()
    assert width / height == pytest.approx(wide / high, rel=0.01)
    assert max(width, height) == pytest.approx(180 / 25.4 * 72, rel=0.01)
