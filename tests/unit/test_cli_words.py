"""The output of the command line: JSON is valid for any program, and no file name causes a traceback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.cli.terminal import as_json
from nvsim.errors import InputError
from nvsim.figures import save_figure
from nvsim.graph import exports
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.project.project import Project


def row() -> NavGraph:
    ids = [f"v{i}" for i in range(4)]
    viewpoints = {id: Viewpoint(id, (2.0 * i, 0.0, 1.5)) for i, id in enumerate(ids)}
    return NavGraph("row", viewpoints, {(a, b): edge(a, b) for a, b in zip(ids, ids[1:])})


def strict(text: str) -> object:
    """Parses it as a program would that knows no NaN."""

    def refuse(word: str) -> None:
        raise ValueError(word)

    return json.loads(text, parse_constant=refuse)


def nvsim(*words: object, **environment: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "nvsim", *(w if isinstance(w, bytes) else str(w) for w in words)]
    return subprocess.run(command, capture_output=True, timeout=120, check=False, env=os.environ | environment)


def test_an_export_to_a_path_with_a_quote_is_told_in_json(tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "house.nvsim") as project:
        project.set_graph(row())
    out = tmp_path / 'the "best" one\\two'
    done = nvsim("export", "r2r", "--project", tmp_path / "house.nvsim", "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    assert Path(json.loads(done.stdout)["written"]).parent == out


def test_what_is_not_a_number_is_null() -> None:
    assert strict(as_json({"a": [1.5, float("nan")], "b": {"c": float("-inf")}})) == {
        "a": [1.5, None],
        "b": {"c": None},
    }


_VALUES = st.recursive(
    st.floats() | st.text() | st.none(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)
)


@settings(deadline=None)
@given(_VALUES)
def test_any_value_is_json_on_one_line(value: object) -> None:
    line = as_json(value)
    strict(line)
    assert "\n" not in line and line.isascii()


@pytest.mark.parametrize("stage", ["check", "graph check"])
@pytest.mark.parametrize("in_json", [False, True])
def test_a_path_that_is_no_utf8_ends_in_a_sentence(tmp_path: Path, stage: str, in_json: bool) -> None:
    nothing = os.fsencode(tmp_path) + b"/caf\xe9.nvsim"
    done = nvsim(*stage.split(), nothing, *(["--json"] if in_json else []), PYTHONIOENCODING="utf-8")
    assert done.returncode == 2 and b"Traceback" not in done.stderr and b"a bug in NVSim" not in done.stderr
    assert b"caf\\udce9.nvsim" in done.stdout + done.stderr
    for line in done.stdout.decode().splitlines() if in_json else []:
        strict(line)


def test_a_terminal_that_knows_only_ascii_gets_every_result(tmp_path: Path) -> None:
    folder = tmp_path / "Küche"
    folder.mkdir()
    write_connectivity(row(), folder)
    done = nvsim("graph", "check", folder / "row_connectivity.json", PYTHONIOENCODING="ascii")
    assert b"Traceback" not in done.stderr and done.returncode in (0, 2), done.stderr


def test_a_graph_in_a_folder_that_is_no_utf8_is_exported(tmp_path: Path) -> None:
    folder = os.fsencode(tmp_path) + b"/caf\xe9"
    os.mkdir(folder)
    write_connectivity(row(), Path(os.fsdecode(folder)))
    file = folder + b"/row_connectivity.json"
    done = nvsim("export", "graph", file, "--out", folder + b"/row.svg", "--json")
    assert done.returncode == 0, done.stderr
    assert os.path.exists(os.fsencode(json.loads(done.stdout)["written"]))


_ID = st.text(st.characters(exclude_characters="/"), min_size=1, max_size=6)
_IDS = st.lists(_ID, min_size=2, max_size=2, unique=True)


@settings(deadline=None, max_examples=60)
@given(_IDS, st.text(max_size=5))
def test_svg_graphml_and_geojson_are_well_formed_whatever_the_names(
    tmp_path_factory: pytest.TempPathFactory, ids: list[str], scan: str
) -> None:
    folder = tmp_path_factory.mktemp("names")
    viewpoints = {id: Viewpoint(id, (float(i), 0.0, 1.5), origin=scan) for i, id in enumerate(ids)}
    graph = NavGraph(scan, viewpoints, {tuple(sorted(ids)): edge(*ids)})  # type: ignore[dict-item]
    from nvsim.graph.exports.formats import write_geojson, write_graphml
    from nvsim.graph.exports.picture import draw

    ElementTree.parse(save_figure(draw(graph), folder / "graph.svg"))
    strict(write_geojson(graph, folder / "graph.geojson").read_text())
    try:
        ElementTree.parse(write_graphml(graph, folder / "graph.graphml"))
    except InputError as error:
        assert "rename it" in str(error) and not all(id.isprintable() for id in ids)
        assert not (folder / "graph.graphml").exists()


def test_an_id_with_control_characters_and_half_a_character_is_seen_in_the_picture(tmp_path: Path) -> None:
    graph = NavGraph("a\x00b", {"x\x1b\ud800": Viewpoint("x\x1b\ud800", (0.0, 0.0, 1.5))}, {})
    path = save_figure(exports.draw(graph), tmp_path / "graph.svg")
    titles = [e.text for e in ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}title")]
    assert titles == ["a\ufffdb", "x\ufffd\ufffd"]
