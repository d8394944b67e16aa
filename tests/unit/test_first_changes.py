"""The first changes of CONTRIBUTING.md, each done with a toy in the table that the page names."""

from __future__ import annotations

from pathlib import Path

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
from nvsim.graph.operations import perform
from nvsim.graph.types import NavGraph, Viewpoint


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
    perform(history, "kneel", {"ids": ["a"]})
    assert history.undo_text == "Kneel" and history.graph.viewpoints["a"].height == 0.5
    history.undo()
    assert history.graph.viewpoints["a"].height == 1.5
    file = write_connectivity(graph, tmp_path)
    assert main(["graph", "edit", str(file), "kneel", "--set", 'ids=["a"]']) == 0
    assert read_connectivity(file).viewpoints["a"].height == pytest.approx(0.5)
