"""Connectivity files from other programs: unedited parts are written back byte by byte, and an edit changes only its
own values."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.graph import edits
from nvsim.graph.connectivity import read_connectivity
from nvsim.graph.findings import check_graph
from nvsim.graph.foreign import ForeignFile, connectivity_files
from nvsim.graph.foreign.document import FlagStyle, read_flags

TILTED = [0.8, -0.6, 0.0, 3.25, 0.012, 0.016, 0.9998, -4.5e0, -0.59988, -0.79984, 0.02, 1.51e0, 0, 0, 0, 1]


def entries(count: int, joined: set[tuple[int, int]]) -> list[dict[str, Any]]:
    """Entries like those of the real files: a tilted pose, extra keys, `visible` that is not symmetric."""
    result = []
    for i in range(count):
        pose = list(TILTED)
        pose[3], pose[7] = round(i * 1.7, 6), -2.0
        result.append(
            {
                "image_id": f"{i:032x}",
                "pose": pose,
                "included": i != 3,
                "visible": [i < j for j in range(count)],
                "unobstructed": [(min(i, j), max(i, j)) in joined for j in range(count)],
                "height": 1.5364,
                "note": {"who": "ü", "tags": ["]", '"', None]},
            }
        )
    return result


LINE = {(0, 1), (1, 2), (2, 3), (3, 4)}
FORMATS: dict[str, Callable[[list[Any]], str]] = {
    "as Python writes": lambda e: json.dumps(e),
    "compact, with a line end": lambda e: json.dumps(e, separators=(",", ":")) + "\n",
    "indented": lambda e: json.dumps(e, indent=2, ensure_ascii=False),
    "indented, Windows": lambda e: json.dumps(e, indent=4).replace("\n", "\r\n"),
    "one entry a line": lambda e: "[\n" + ",\n".join(json.dumps(x) for x in e) + "\n]\n",
    "ones and zeros": lambda e: json.dumps(e).replace("true", "1").replace("false", "0"),
    "spaces here and there": lambda e: json.dumps(e).replace("true, true", "true ,true").replace(": ", " :  "),
    "mixed": lambda e: json.dumps(e).replace("false, true, false", "0, true, false"),
    "byte order mark": lambda e: "\ufeff" + json.dumps(e),
}


def opened(tmp_path: Path, text: str, scan: str = "house") -> ForeignFile:
    path = tmp_path / f"{scan}_connectivity.json"
    path.write_bytes(text.encode())
    return ForeignFile.open(path)


@pytest.mark.parametrize("style", FORMATS)
def test_an_unedited_file_is_written_back_to_the_byte(tmp_path: Path, style: str) -> None:
    text = FORMATS[style](entries(5, LINE))
    file = opened(tmp_path, text)
    file.save(file.graph)
    assert file.path.read_bytes() == text.encode()
    assert not [p for p in tmp_path.iterdir() if p != file.path]


@pytest.mark.parametrize("style", FORMATS)
def test_an_edit_changes_its_own_values_and_nothing_else(tmp_path: Path, style: str) -> None:
    file = opened(tmp_path, FORMATS[style](entries(5, LINE)).replace("-2.0", "-1.500E0"))
    ids = list(file.graph.viewpoints)
    graph = edits.remove_edge(file.graph, ids[0], ids[1])
    graph = edits.move_viewpoint(graph, ids[2], (3.5, -1.5, 1.51))
    graph = edits.set_included(edits.set_height(graph, [ids[4]], 1.25), [ids[4]], False)
    before = file.text()
    file.save(graph)
    after = file.path.read_bytes().decode()
    wanted = json.loads(before.removeprefix("\ufeff"))
    wanted[0]["unobstructed"][1] = wanted[1]["unobstructed"][0] = False
    wanted[2]["pose"][3] = 3.5
    wanted[4]["included"], wanted[4]["height"] = False, 1.25
    wanted[4]["pose"][11] = graph.viewpoints[ids[4]].position[2]
    assert json.loads(after.removeprefix("\ufeff")) == wanted
    assert "1.500E0" in after, "numbers that stay keep their text"
    assert ForeignFile.open(file.path).graph.edges.keys() == graph.edges.keys()


def test_lists_grow_and_shrink_with_the_viewpoints(tmp_path: Path) -> None:
    file = opened(tmp_path, FORMATS["indented"](entries(5, LINE)))
    ids = list(file.graph.viewpoints)
    graph = edits.remove_viewpoints(file.graph, [ids[1]])
    graph = edits.place_viewpoint(graph, (9.0, 1.0, 1.5), id="new")
    graph = edits.add_edge(graph, "new", ids[4])
    graph = edits.rename_viewpoint(graph, ids[0], "renamed")
    before = json.loads(file.text())
    file.save(graph)
    after = json.loads(file.path.read_text())
    assert [e["image_id"] for e in after] == ["renamed", *ids[2:], "new"]
    keep = [0, 2, 3, 4]
    for row, old in zip(after, keep):
        assert row["visible"][:4] == [before[old]["visible"][k] for k in keep]
        assert row["note"] == before[old]["note"] and row["pose"] == before[old]["pose"]
    assert after[4]["unobstructed"] == after[4]["visible"] == [False, False, False, True, False]
    assert after[3]["unobstructed"][4] and set(after[4]) == set(before[0]) - {"note"}
    assert [after[4]["pose"][k] for k in (3, 7, 11)] == [9.0, 1.0, 1.5]
    assert file.path.read_text() == json.dumps(after, indent=2, ensure_ascii=False)
    again = read_connectivity(file.path)
    assert list(again.viewpoints) == list(graph.viewpoints) and again.edges.keys() == graph.edges.keys()


def test_an_empty_file_can_be_filled_and_a_full_one_emptied(tmp_path: Path) -> None:
    file = opened(tmp_path, "[ ]\n")
    file.save(edits.place_viewpoint(file.graph, (1, 2, 3), id="a"))
    assert list(read_connectivity(file.path).viewpoints.values())[0].position == (1, 2, 3)
    file.save(edits.remove_viewpoints(file.graph, ["a"]))
    assert json.loads(file.path.read_text()) == []


def test_one_way_edges_self_edges_and_short_lists_are_findings_that_can_be_mended(tmp_path: Path) -> None:
    rows = entries(4, {(0, 1), (1, 2), (2, 3)})
    rows[1]["unobstructed"][0] = False
    rows[2]["unobstructed"][2] = True
    rows[3]["visible"] = [False]
    text = json.dumps(rows)
    file = opened(tmp_path, text)
    ids = list(file.graph.viewpoints)
    kinds = {f.kind: f for f in check_graph(file.graph, file.context())}
    assert {"one_way", "self", "length"} <= set(kinds)
    assert kinds["one_way"].edges == ((ids[0], ids[1]),) and kinds["length"].viewpoints == (ids[3],)
    file.save(file.graph)
    assert file.path.read_text() == text, "not edited, not changed"
    graph = edits.mark_reviewed(file.graph, [ids[2]], [(ids[0], ids[1])])
    file.save(edits.mark_reviewed(graph, [ids[3]]))
    again = ForeignFile.open(file.path)
    matrix = np.array([e["unobstructed"] for e in json.loads(again.text())])
    assert (matrix == matrix.T).all() and not matrix.diagonal().any() and matrix[1, 0]
    assert not again.one_way and not again.context().entries
    assert again.graph.edges[ids[0], ids[1]].reviewed, "marks are noted beside the file"
    again.save(edits.mark_reviewed(again.graph, ids, list(again.graph.edges), False))
    kept = {file.path.name, f"{file.path.name}~", "house_review.json"}
    assert {p.name for p in tmp_path.iterdir()} == kept
    assert set(json.loads((tmp_path / "house_review.json").read_text())) == {"original"}, "no marks are left"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{}", "does not hold a list"),
        ("[{}]", "entry 0"),
        ("[1]", "entry 0 is not an object"),
        ('[{"image_id": "a", "pose": [1], "unobstructed": [false]}]', "entry 0: pose"),
        ('[{"image_id": "a", "unobstructed": [false, 2]}]', "entry 0: unobstructed"),
        ('[{"image_id": "a", "unobstructed": [false, T]}]', "entry 0: unobstructed"),
        ('[{"image_id": "a", "unobstructed": [false false]}]', "entry 0: unobstructed"),
        ('[{"image_id": "a", "unobstructed": [fal se]}]', "entry 0: unobstructed"),
        ('[{"image_id": "a", "unobstructed": [[true]]}]', "entry 0: unobstructed"),
        ('[{"image_id": "a"}]', "entry 0 has no unobstructed"),
        ('[{"image_id": "a", "image_id": "b"}]', "entry 0 has the key 'image_id' twice"),
        ('[{"image_id": "a", "x": nul}]', "entry 0, line 1"),
        ("[" + json.dumps(entries(1, set())[0]) + ",]", "entry 1"),
        ("[" + json.dumps(entries(1, set())[0]) + "", "entry 0 is not followed"),
        (json.dumps(entries(1, set()) * 2), "entry 1: image_id"),
        (json.dumps(entries(1, set())) + "x", "has text after the end"),
    ],
)
def test_malformed_files_are_refused_with_the_entry_and_the_reason(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        opened(tmp_path, text)


def test_a_file_that_changed_on_disk_is_not_overwritten(tmp_path: Path) -> None:
    file = opened(tmp_path, json.dumps(entries(2, {(0, 1)})))
    file.path.write_text("[]")
    with pytest.raises(InputError, match="changed by another program"):
        file.save(file.graph)
    file.save(file.graph, tmp_path / "else" / "b_connectivity.json")
    assert (tmp_path / "else" / "scans.txt").read_text() == "b\n" and file.scan == "b"


def test_a_folder_means_the_scans_it_lists(tmp_path: Path) -> None:
    for scan in "abc":
        (tmp_path / f"{scan}_connectivity.json").write_text("[]")
    assert len(connectivity_files(tmp_path)) == 3
    (tmp_path / "scans.txt").write_text("c\na\n")
    assert [p.name[0] for p in connectivity_files(tmp_path)] == ["c", "a"]
    (tmp_path / "scans.txt").write_text("c\nd\n")
    with pytest.raises(InputError, match="lists d"):
        connectivity_files(tmp_path)


def test_pictures_beside_the_file_are_found(tmp_path: Path) -> None:
    folder = tmp_path / "scans" / "house" / "matterport_skybox_images"
    folder.mkdir(parents=True)
    file = opened(tmp_path, json.dumps(entries(3, {(0, 1), (1, 2)})))
    ids = list(file.graph.viewpoints)
    (folder / f"{ids[0]}_skybox_small.jpg").touch()
    found = [f for f in check_graph(file.graph, file.context()) if f.kind == "panorama"]
    assert [f.viewpoints for f in found] == [(ids[1],), (ids[2],)]
    x, y, z = file.graph.viewpoints[ids[0]].position
    file.save(edits.move_viewpoint(file.graph, ids[0], (x + 0.5, y, z)))
    (moved,) = [f for f in check_graph(file.graph, file.context()) if f.kind == "moved"]
    assert moved.viewpoints == (ids[0],) and "0.50 m" in moved.message


def agents_matrix(path: Path) -> dict[tuple[str, str], bool]:
    data = json.loads(path.read_bytes().decode().removeprefix("\ufeff"))
    ids = [e["image_id"] for e in data]
    assert all(len(e["unobstructed"]) == len(data) == len(e["visible"]) for e in data)
    return {(a, b): bool(e["unobstructed"][j]) for a, e in zip(ids, data) for j, b in enumerate(ids)}


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(list(FORMATS)),
    st.integers(1, 7),
    st.sets(st.tuples(st.integers(0, 6), st.integers(0, 6))),
    st.lists(
        st.tuples(
            st.sampled_from(["add", "remove", "join", "part", "move", "save"]), st.integers(0, 9), st.integers(0, 9)
        )
    ),
)
def test_whatever_is_edited_and_saved_is_what_is_opened_again(
    tmp_path_factory: pytest.TempPathFactory, style: str, count: int, pairs: set[tuple[int, int]], steps: list[tuple]
) -> None:
    joined = {(i, j) for i, j in pairs if i < j < count}
    file = opened(tmp_path_factory.mktemp("f"), FORMATS[style](entries(count, joined)))
    graph = file.graph
    for n, (name, i, j) in enumerate([*steps, ("save", 0, 0)]):
        ids = list(graph.viewpoints)
        a, b = (ids[i % len(ids)], ids[j % len(ids)]) if ids else ("", "")
        try:
            if name == "add":
                graph = edits.place_viewpoint(graph, (i + n * 0.125, j, 1.5), id=f"n{n}")
            elif name == "remove":
                graph = edits.remove_viewpoints(graph, [a])
            elif name == "join":
                graph = edits.add_edge(graph, a, b)
            elif name == "part":
                graph = edits.remove_edge(graph, a, b)
            elif name == "move":
                graph = edits.move_viewpoint(graph, a, (i * 0.1, j * 0.3, 1.0))
            else:
                file.save(graph)
        except edits.EditError:
            continue
    again = ForeignFile.open(file.path).graph
    assert {id: (v.position, v.height, v.included) for id, v in again.viewpoints.items()} == {
        id: (v.position, v.height, v.included) for id, v in graph.viewpoints.items()
    }
    assert list(again.viewpoints) == list(graph.viewpoints) and again.edges.keys() == graph.edges.keys()
    matrix = agents_matrix(file.path)
    assert {(min(k), max(k)) for k, free in matrix.items() if free} == graph.edges.keys()
    assert all(matrix[b, a] == free for (a, b), free in matrix.items())


STYLES = st.builds(
    lambda opening, separator, closing, words: FlagStyle(opening, separator, closing, *words),
    st.sampled_from(["[", "[\n  ", "[ "]),
    st.sampled_from([",", " , ", ",\n\t", ", "]),
    st.sampled_from(["]", "\n ]"]),
    st.sampled_from([("true", "false"), ("1", "0")]),
)


@settings(max_examples=400, deadline=None)
@given(STYLES, st.lists(st.sampled_from([False, False, False, True]), min_size=1, max_size=30), st.data())
def test_lists_of_flags_are_read_as_json_reads_them(style: FlagStyle, values: list[bool], data: st.DataObject) -> None:
    text = style.write(np.array(values))
    assert json.loads(text) == values
    found, kept = read_flags(text)
    assert found.tolist() == values and kept is not None and kept.write(found) == text
    at = data.draw(st.integers(0, len(text) - 1))
    damaged = text[:at] + data.draw(st.sampled_from("tfalseru01, []T\n")) + text[at + 1 :]
    try:
        wanted = json.loads(damaged)
        legal = isinstance(wanted, list) and all(isinstance(v, bool | int) and v in (0, 1) for v in wanted)
    except ValueError:
        legal = False
    if legal:
        assert read_flags(damaged)[0].tolist() == wanted
    else:
        with pytest.raises(ValueError):
            read_flags(damaged)


def test_connecting_what_is_visible_asks_the_file_where_there_is_no_map(tmp_path: Path) -> None:
    listed = entries(4, set())
    for i, entry in enumerate(listed):
        entry["included"], entry["visible"] = True, [i == 0 and j in (1, 2) for j in range(4)]
    file = opened(tmp_path, json.dumps(listed))
    ids = list(file.graph.viewpoints)
    joined = edits.connect_visible(file.graph, ids, 100.0, file.visibility())
    assert set(joined.edges) == {(ids[0], ids[1]), (ids[0], ids[2])}
    more = edits.place_viewpoint(file.graph, (1.0, 1.0, 1.5), id="new")
    assert len(edits.connect_visible(more, more.viewpoints, 100.0, file.visibility()).edges) == 2 + 4, (
        "of it nothing is known"
    )
    for entry in listed:
        del entry["visible"]
    assert opened(tmp_path, json.dumps(listed), "other").visibility() is None
    for entry in listed:
        entry["visible"] = entry["unobstructed"]
    assert opened(tmp_path, json.dumps(listed), "copied").visibility() is None, (
        "that says nothing but which edges there are"
    )
