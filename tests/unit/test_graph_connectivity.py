"""R2R connectivity files against a loader like the agents', and against files of other people."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.geometry.camera import camera_pose
from nvsim.graph.connectivity import read_connectivity, write_connectivity
from nvsim.graph.types import NavGraph, Viewpoint, edge


def sample(scan: str = "house1") -> NavGraph:
    places = {"a": (0.0, 0.0, 1.5), "b": (2.0, 1.5, 1.5), "c": (4.0, 0.25, 1.6), "d": (9.0, 9.0, 1.5)}
    viewpoints = {id: Viewpoint(id, xyz, 1.4, 0, id != "d", "step") for id, xyz in places.items()}
    return NavGraph(scan, viewpoints, {e.key: e for e in (edge("b", "a"), edge("c", "b"), edge("d", "c"))})


def load_as_the_agents_do(folder: Path) -> dict[str, nx.Graph]:
    """The fields that the agents' `load_nav_graphs` reads from the files, written from its description."""
    graphs = {}
    for scan in (folder / "scans.txt").read_text().split():
        data = json.loads((folder / f"{scan}_connectivity.json").read_text())
        found = nx.Graph()
        for i, item in enumerate(data):
            for j, free in enumerate(item["unobstructed"]):
                if item["included"] and free and data[j]["included"]:
                    assert data[j]["unobstructed"][i], "Graph should be undirected"
                    a, b = (np.array([e["pose"][k] for k in (3, 7, 11)]) for e in (item, data[j]))
                    found.add_edge(item["image_id"], data[j]["image_id"], weight=float(np.linalg.norm(a - b)))
        graphs[scan] = found
    return graphs


def test_written_files_load_like_the_agents_load_them(tmp_path: Path) -> None:
    for scan in ("house1", "house2", "house1"):
        write_connectivity(sample(scan), tmp_path)
    graphs = load_as_the_agents_do(tmp_path)
    assert list(graphs) == ["house1", "house2"]
    assert sorted(map(sorted, graphs["house1"].edges)) == [["a", "b"], ["b", "c"]], "d is not included"
    assert nx.dijkstra_path_length(graphs["house1"], "a", "c") == pytest.approx(2.5 + np.hypot(2, np.hypot(1.25, 0.1)))
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_entries_hold_the_six_keys_and_a_level_pose_towards_y(tmp_path: Path) -> None:
    entries = json.loads(write_connectivity(sample(), tmp_path).read_text())
    for entry, v in zip(entries, sample().viewpoints.values()):
        assert set(entry) == {"image_id", "pose", "included", "visible", "unobstructed", "height"}
        assert np.allclose(np.reshape(entry["pose"], (4, 4)), camera_pose(np.array(v.position), 0.0))
        assert entry["height"] == 1.4 and type(entry["included"]) is bool
    joined = np.array([e["unobstructed"] for e in entries])
    assert (joined == joined.T).all() and not joined.diagonal().any()
    assert np.array_equal(joined, [e["visible"] for e in entries])


def test_who_sees_whom_can_be_told(tmp_path: Path) -> None:
    path = write_connectivity(sample(), tmp_path, visible=lambda a, b: b.position[0] > a.position[0])
    seen = np.array([e["visible"] for e in json.loads(path.read_text())])
    assert np.array_equal(seen, np.triu(np.ones((4, 4), bool), 1))


@pytest.mark.parametrize("scan", ["a_b", "a b", "a/b", "", "../x", "ä", "a\n", ".hidden"])
def test_scan_ids_that_agents_cannot_use_are_refused(tmp_path: Path, scan: str) -> None:
    with pytest.raises(InputError, match="scan id"):
        write_connectivity(sample(scan), tmp_path)
    assert not list(tmp_path.iterdir())


def test_reading_gives_back_what_was_written(tmp_path: Path) -> None:
    before = sample()
    after = read_connectivity(write_connectivity(before, tmp_path))
    assert after.scan == before.scan and list(after.edges) == list(before.edges)
    for a, b in zip(before.viewpoints.values(), after.viewpoints.values()):
        assert (a.id, a.position, a.height, a.included) == (b.id, b.position, b.height, b.included)
        assert b.origin == "file"


def entry(id: str, joined: list[Any], **more: Any) -> dict[str, Any]:
    pose = camera_pose(np.array([len(id), 2.0, 1.5]), 0.3).reshape(-1).tolist()
    return {"image_id": id, "pose": pose, "unobstructed": joined, **more}


def write(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path


def test_files_of_others_may_be_sparse_and_talkative(tmp_path: Path) -> None:
    content = [entry("a", [0, 1], included=1, note="hall"), entry("bb", [True, True], included=False)]
    found = read_connectivity(write(tmp_path / "x_connectivity.json", content))
    assert found.scan == "x" and list(found.edges) == [("a", "bb")], "an edge to itself is passed over"
    assert [v.included for v in found.viewpoints.values()] == [True, False]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([entry("one", [0, 1]), entry("two", [0, 0])], "from one to two goes one way only"),
        ([entry("one", [0, 1])], "list of 1 booleans"),
        ([entry("one", ["yes"])], "only true, false"),
        ([entry("one", [0, 0]), entry("one", [0, 0])], "used twice"),
        ([{"image_id": "one", "unobstructed": [0]}], "16 numbers"),
        ([entry("one", [0], pose=[0] * 16)], "not a rotation"),
        ([entry("one", [0], pose=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1])], "last row"),
        ([entry("one", [0], height="tall")], "height"),
        ([entry("a/b", [0])], "without slash"),
        ([5], "not an object"),
        ({"a": 1}, "list of viewpoints"),
    ],
)
def test_bad_files_are_refused_with_the_entry(tmp_path: Path, content: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_connectivity(write(tmp_path / "x.json", content))


def test_missing_and_torn_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "torn.json").write_text('[{"image_id": "a", ')
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    for name, words in (("none.json", "Cannot read"), ("torn.json", "not JSON"), ("bytes.json", "not text")):
        with pytest.raises(InputError, match=words):
            read_connectivity(tmp_path / name)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.dictionaries(
            st.sampled_from(["image_id", "pose", "included", "unobstructed", "height", "visible"]),
            JSON | st.lists(st.floats(), min_size=16, max_size=16) | st.lists(st.booleans(), max_size=4),
        ),
        max_size=4,
    )
    | JSON
)
def test_reader_gives_a_graph_or_a_sentence(tmp_path_factory: pytest.TempPathFactory, content: Any) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz_connectivity.json"
    path.write_text(json.dumps(content))
    try:
        found = read_connectivity(path)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert all(a in found.viewpoints and b in found.viewpoints and a < b for a, b in found.edges)


@pytest.mark.parametrize(
    ("listed", "files", "becomes"),
    [
        ("kitchen\nhal", ["kitchen"], "kitchen\nhall\n"),  # of the scan that is written again
        ("kit", ["kitchen"], "kitchen\nhall\n"),  # of another, whose file is there
        ("hall\nkit", ["kitchen", "kitten"], "hall\n"),  # of which one cannot be said
        ("hall\nkit", [], "hall\n"),
        ("kitchen\nhall", ["kitchen"], "kitchen\nhall"),  # whole, by someone who ends no line
        ("gone\nhall\n", [], "gone\nhall\n"),  # whole: of a scan that lies elsewhere
    ],
)
def test_a_line_of_scans_txt_that_was_cut_off_is_repaired(
    tmp_path: Path, listed: str, files: list[str], becomes: str
) -> None:
    for name in files:
        (tmp_path / f"{name}_connectivity.json").write_text("[]")
    (tmp_path / "scans.txt").write_text(listed)
    graph = NavGraph("hall", {"a": Viewpoint("a", (0.0, 0.0, 1.5))}, {})
    for _ in range(2):  # the second time there is nothing to do
        write_connectivity(graph, tmp_path)
        assert (tmp_path / "scans.txt").read_text() == becomes
