"""`nvsim graph ...` on a project and on a connectivity file."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from nvsim.cli.main import COMMANDS, main
from nvsim.cli.options import command_of
from nvsim.graph.connectivity import read_connectivity, write_connectivity
from nvsim.graph.journal import Journal, sidecar
from nvsim.graph.operations import perform_operation
from nvsim.graph.store import same_graph
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.project.layout import Layout
from nvsim.project.project import Project


def row() -> NavGraph:
    ids = [f"v{i}" for i in range(6)]
    viewpoints = {id: Viewpoint(id, (2.0 * i + (i == 5), 0.0, 1.5), origin="file") for i, id in enumerate(ids)}
    return NavGraph("row", viewpoints, {(a, b): edge(a, b, "file") for a, b in zip(ids, ids[1:])})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return write_connectivity(row(), tmp_path / "connectivity")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    with Project.create_or_open(tmp_path / "p.nvsim") as made:
        made.set_graph(row())
    return tmp_path / "p.nvsim"


def test_select_prints_what_the_expression_holds_for(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["graph", "select", str(file), "degree == 1"]) == 0
    assert capsys.readouterr().out.split() == ["v0", "v5"]
    assert main(["graph", "select", str(file), "length > 2.5", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"viewpoints": [], "edges": [["v4", "v5"]]}


def test_edit_changes_a_file_and_leaves_but_the_original_beside_it(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["graph", "edit", str(file), "remove_edges", "--where", "length > 2.5", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["text"] == "Remove edge v4 – v5" and printed["changed"]["removed_edges"] == 1
    assert ("v4", "v5") not in read_connectivity(file).edges
    left = ["row_connectivity.json", "row_connectivity.json~", "row_review.json", "scans.txt"]
    assert sorted(p.name for p in file.parent.iterdir()) == left and printed["original"] == f"{file}~"


def test_dry_run_and_out_leave_the_file_alone(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    held = file.read_bytes()
    edit = ["graph", "edit", str(file), "set_height", "--where", "x > 3", "--set", "height=1.2"]
    assert main([*edit, "--dry-run"]) == 0 and "4 viewpoints changed" in capsys.readouterr().out
    assert main([*edit, "--out", str(tmp_path / "other_connectivity.json")]) == 0
    assert file.read_bytes() == held
    assert read_connectivity(tmp_path / "other_connectivity.json").viewpoints["v3"].height == 1.2


def test_edits_of_a_project_can_be_undone_and_replayed(project: Path, file: Path, tmp_path: Path) -> None:
    p, script = str(project), tmp_path / "script.jsonl"
    assert main(["graph", "edit", p, "add_viewpoint", "--set", "position=[1, 1, 1.5]", "id=door"]) == 0
    assert main(["graph", "edit", p, "add_edges", "--set", 'pairs=[["door", "v0"], ["door", "v1"]]']) == 0
    assert main(["graph", "log", p, "--script", str(script)]) == 0
    assert main(["graph", "replay", str(file), str(script)]) == 0
    assert ("door", "v1") in read_connectivity(file).edges
    with Project.open(project) as opened, Journal.open(Layout(project).edits) as journal:
        graph = opened.need_graph()
        history = journal.history(graph)
        assert history.is_saved and ("door", "v0") in graph.edges
        assert history.undo() and history.undo() and same_graph(history.graph, row())


def test_a_script_is_done_whole_or_not_at_all(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "script.jsonl"
    script.write_text('{"edit": "include", "ids": ["v1"], "included": false}\n\n# later\n{"edit": "include"}\n')
    assert main(["graph", "replay", str(project), str(script)]) == 2
    assert "script.jsonl, line 4: include needs ids" in capsys.readouterr().err
    with Project.open(project) as opened:
        assert same_graph(opened.need_graph(), row())


def test_unsaved_edits_of_a_window_are_not_run_over(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit = ["graph", "edit", str(file), "remove_edges", "--where", "length > 2.5"]
    with Journal.open(sidecar(file), plain=True) as journal:
        perform_operation(journal.history(read_connectivity(file)), "remove_viewpoints", {"ids": ["v0"]})
        assert main(edit) == 2 and "edited in a window" in capsys.readouterr().err
    assert main(edit) == 2 and "has 1 unsaved edit;" in capsys.readouterr().err
    assert len(read_connectivity(file).edges) == 5


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["edit", "FILE", "fly"], "no edit 'fly'"),
        (["edit", "FILE", "include", "--where", "degree >"], "not a valid expression"),
        (["edit", "FILE", "include", "--set", "ids"], "write NAME=VALUE"),
        (["edit", "FILE", "rename_viewpoint", "--where", "degree > 1"], "takes no viewpoints or edges"),
        (["select", "nowhere.json", "degree > 1"], "does not exist"),
        (["select", "FILE", "validity < 1"], "there is none"),
        (["replay", "FILE", "nowhere.jsonl"], "Cannot read"),
    ],
)
def test_mistakes_are_said_in_a_sentence(
    words: list[str], message: str, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["graph", *(str(file) if w == "FILE" else w for w in words)]) == 2
    assert message in capsys.readouterr().err


def test_export_writes_the_file_that_is_named_in_the_format_of_its_suffix(file: Path, tmp_path: Path) -> None:
    for name in ("mine.graphml", "mine.geojson", "mine.svg", "mine.png"):
        assert main(["export", "graph", str(file), "--out", str(tmp_path / name)]) == 0
        assert (tmp_path / name).is_file()
    assert len(json.loads((tmp_path / "mine.geojson").read_text())["features"]) == 11
    assert main(["export", "graph", str(file), "--out", str(tmp_path / "picture.jpg")]) == 2
    assert not (tmp_path / "picture.jpg").exists()
    assert main(["export", "graph", str(file), "--out", str(tmp_path / "folder")]) == 0
    assert (tmp_path / "folder" / "row.graphml").is_file()


def test_what_means_the_same_has_one_name_in_every_graph_command() -> None:
    named = [name for name in COMMANDS if name.startswith("graph ") or name in ("export graph", "evaluate graph")]
    fields: dict[str, set[str]] = {}
    for name in named:
        fields[name] = {field.name for field in dataclasses.fields(command_of(name))}
    assert len(named) >= 10
    for name, has in fields.items():
        # A graph is `graph`, a map `occupancy`, a robot's radius `robot_radius`, and what is written goes to `out`.
        assert not has & {"path", "file", "map", "radius", "merge", "output"}, name


def test_an_exported_graph_has_the_stub_that_agents_open_and_the_check_skips_it(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    export = ["export", "r2r", "--project", str(project), "--out", str(out)]
    assert main(export) == 0 and (out / "scans.txt").read_text() == "p\nZMojNkEp431\n"
    stub = json.loads((out / "ZMojNkEp431_connectivity.json").read_text())
    assert [entry["image_id"] for entry in stub] == ["2f4d90acd4024c269fb0efe49a8ac540"] and stub[0]["included"]
    capsys.readouterr()
    assert main(["graph", "check", str(out), "--json"]) == 0
    assert [scan["scan"] for scan in json.loads(capsys.readouterr().out)] == ["p"]
    assert main(["graph", "check", str(out / "ZMojNkEp431_connectivity.json")]) == 1  # a file that is named is checked
    assert main([*export[:-1], str(tmp_path / "bare"), "--no-stub"]) == 0
    assert (tmp_path / "bare" / "scans.txt").read_text() == "p\n"
