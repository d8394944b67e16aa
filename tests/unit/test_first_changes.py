"""The first changes of CONTRIBUTING.md, each done with a toy in the table that the page names."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pytest

from nvsim.capture import formats
from nvsim.capture.findings import Findings
from nvsim.capture.raw import RawCapture
from nvsim.cli.main import main
from nvsim.graph import operation_table
from nvsim.graph.arguments import Argument
from nvsim.graph.connectivity import read_connectivity, write_connectivity
from nvsim.graph.edits import set_height
from nvsim.graph.history import History
from nvsim.graph.operations import perform_operation
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.mapping import criteria
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import decide
from nvsim.mapping.evidence.rethreshold import Rethresholder
from nvsim.mapping.explanation.explain import closed_edge_reason, explain, smallest_margin
from nvsim.project.project import Project
from nvsim_app.state.directions import directions
from nvsim_app.state.graph_arrays import GraphArrays
from nvsim_app.thresholds.slider import thresholds

ROOT = Path(__file__).parents[2]


def test_a_capture_reader_is_a_file_and_a_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def find(path: Path) -> Path | None:
        return path / "toy.walk" if (path / "toy.walk").is_file() else None

    def read(path: Path, findings: Findings) -> RawCapture:
        findings.warning("the toy was read", path.name, "nothing follows")
        return RawCapture(path, "toy", (), None, metric=True)

    row = formats.Format("toy", "a toy (toy.walk)", find, read)
    monkeypatch.setattr(formats, "FORMATS", (*formats.FORMATS, row))
    assert main(["check", str(tmp_path)]) == 2
    assert "a toy (toy.walk)" in capsys.readouterr().out and "toy" in formats.names()
    (tmp_path / "toy.walk").write_text("a walk\n")
    main(["check", str(tmp_path)])
    assert "the toy was read" in capsys.readouterr().out


def test_an_operation_is_a_function_and_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    row = operation_table.Operation(
        "kneel",
        "Lower cameras to half a metre",
        lambda graph, surroundings, ids: set_height(graph, ids, 0.5),
        (Argument("ids", "viewpoints", "ids of viewpoints"),),
        lambda a: "Kneel",
    )
    monkeypatch.setitem(operation_table.OPERATIONS, "kneel", row)
    graph = NavGraph("row", {id: Viewpoint(id, (x, 0.0, 1.5)) for id, x in (("a", 0.0), ("b", 2.0))}, {})
    history = History(graph)
    perform_operation(history, "kneel", {"ids": ["a"]})
    assert history.undo_text == "Kneel" and history.graph.viewpoints["a"].height == 0.5
    history.undo()
    assert history.graph.viewpoints["a"].height == 1.5
    file = write_connectivity(graph, tmp_path)
    assert main(["graph", "edit", str(file), "kneel", "--set", 'ids=["a"]']) == 0
    assert read_connectivity(file).viewpoints["a"].height == pytest.approx(0.5)


ROW = """    Criterion(
        "cell_support", "unknown", "least cell's known floor", "Cell known, least", "support", "cell", False, True
    ),
"""
THRESHOLD = '    cell_support: float = 0.5\n    """Share of every cell that must be known as floor."""\n'


@dataclass(frozen=True)
class ToyConfig(MappingConfig):
    cell_support: float = 0.5


@dataclass(frozen=True)
class PaperWithToy(MappingConfig):
    mean_support: float = 1.0


def two_viewpoints() -> NavGraph:
    """An edge along a corridor in which the floor of one cell is not known: enough for every row, not for the toy."""
    known = np.ones((29, 18), bool)
    known[10, 9] = False
    blank = np.zeros(known.shape, np.uint8)
    evidence = Evidence("a", 0, 0.0, 2.5, blank, blank + 255, known, 0.0, 0.1, 0.9, 0, (0.0, 2.5), decision="open")
    viewpoints = {id: Viewpoint(id, (0.0, y, 1.5)) for id, y in (("a", 0.0), ("b", 2.5))}
    return NavGraph("pair", viewpoints, {("a", "b"): edge("a", "b")}, {evidence.key: evidence})


def test_an_edge_criterion_is_a_threshold_and_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    row = eval(ROW.strip().rstrip(","), {"Criterion": criteria.Criterion})
    graph, config = two_viewpoints(), ToyConfig()
    (evidence,) = graph.evidence.values()
    assert decide(evidence, config) == "open"
    monkeypatch.setattr(criteria, "CRITERIA", (*criteria.CRITERIA, row))
    assert decide(evidence, config) == "unknown"
    assert Rethresholder(graph).decide(config).lost_edges.tolist() == [[0, 1]]
    assert len(Rethresholder(graph).decide(replace(config, cell_support=0.0)).lost_edges) == 0
    failed = explain(evidence, config).failed
    assert failed is not None and failed.criterion is row and failed.part == (slice(10, 11), slice(9, 10))
    (direction,) = directions(graph, GraphArrays.of(graph), "a", config)  # what inspector and details show
    assert (
        "least cell's known floor 0.00, threshold 0.50" in direction.sentence
        and direction.outcome_label == "floor not seen"
    )
    assert "no image and no LiDAR scan shows floor" in closed_edge_reason(config)(graph, ("a", "b"))
    assert smallest_margin(config)(graph, ("a", "b")) == -0.5
    assert "Cell known, least" in [threshold.name for threshold in thresholds()]


def test_an_edge_criterion_does_not_change_the_papers_map(monkeypatch: pytest.MonkeyPatch) -> None:
    row = criteria.Criterion("mean_support", "unknown", "mean known floor", "Mean known", "support", "corridor", False)
    paper = MappingConfig.paper()
    added = PaperWithToy(**{field.name: getattr(paper, field.name) for field in fields(paper)})
    (evidence,) = two_viewpoints().evidence.values()
    assert decide(evidence, paper) == decide(evidence, added) == "open"
    monkeypatch.setattr(criteria, "CRITERIA", (*criteria.CRITERIA, row))
    assert decide(evidence, replace(added, rule="worst")) == "unknown"
    assert decide(evidence, added) == "open" and not row.is_used(added)
    assert added.key == paper.key, "a map of the paper stays valid"
    assert "mean_support" in replace(added, rule="worst").key[MappingConfig.__name__]


def test_a_criterion_in_two_files_is_in_the_commands_and_in_the_window(tmp_path: Path) -> None:
    (tmp_path / "nvsim" / "mapping").mkdir(parents=True)
    for path in (ROOT / "app" / "nvsim_app", ROOT / "resources" / "nvsim_resources"):
        (tmp_path / path.name).symlink_to(path)
    for folder in ("nvsim", "nvsim/mapping"):
        for path in (ROOT / folder).iterdir():
            if not (tmp_path / folder / path.name).exists() and path.name != "__pycache__":
                (tmp_path / folder / path.name).symlink_to(path)
    for name, before, added in (
        ("config.py", "    both_ways: bool", THRESHOLD),
        ("criteria.py", ')\n"""The order in which criteria are tested', ROW),
    ):
        path = tmp_path / "nvsim" / "mapping" / name
        text = path.read_text()
        path.unlink()
        path.write_text(text.replace(before, added + before, 1))
    with Project.create_or_open(tmp_path / "p.nvsim") as project:
        project.set_graph(two_viewpoints())
    script = """
from pathlib import Path
from PySide6.QtWidgets import QApplication
from nvsim_app.forms.fields import fields_of
from nvsim_app.state.document import Document
from nvsim_app.thresholds.panel import ThresholdPanel
from nvsim_app.thresholds.threshold_preview import ThresholdPreview
from nvsim.cli.main import main
application = QApplication([])
document = Document()
row = ThresholdPanel(ThresholdPreview(document), document).rows["cell_support"]
print(row.name.text(), row.figure.value(), "|", row.toolTip() or row.name.toolTip())
print([field.flag for field in fields_of("map") if "cell_support" in field.path])
main(["graph", "check", "p.nvsim", "--json"])
main(["map", "--help-all"])
"""
    ran = subprocess.run(
        [sys.executable, "-P", "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path), "QT_QPA_PLATFORM": "offscreen"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    print(ran.stdout, ran.stderr)
    assert "Cell known, least 0.5" in ran.stdout and "['--cell-support']" in ran.stdout
    assert "no image and no LiDAR scan shows floor along the corridor" in ran.stdout
    assert "Share of every cell that must be known" in ran.stdout.partition("usage:")[2]
