"""A foreign connectivity file is copied before the first edit replaces it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.graph import edits
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.foreign import ForeignFile, disconnected_warning, saving_message
from nvsim.graph.types import NavGraph, Viewpoint, edge


def row(count: int = 5) -> NavGraph:
    ids = [f"v{i}" for i in range(count)]
    viewpoints = {id: Viewpoint(id, (2.0 * i, 0.0, 1.5)) for i, id in enumerate(ids)}
    return NavGraph("house", viewpoints, {(a, b): edge(a, b) for a, b in zip(ids, ids[1:])})


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_connectivity(row(), tmp_path)
    (tmp_path / "scans.txt").unlink()
    return tmp_path / "house_connectivity.json"


def cut(path: Path, a: str, b: str) -> ForeignFile:
    """Another opening, another edit, another save."""
    file = ForeignFile.open(path)
    file.save(edits.remove_edge(file.graph, a, b))
    return file


def test_the_first_save_keeps_the_original_and_later_ones_leave_it(path: Path) -> None:
    before = path.read_bytes()
    kept = path.with_name(f"{path.name}~")
    file = cut(path, "v0", "v1")
    assert file.original == kept and kept.read_bytes() == before
    file.save(edits.remove_edge(file.graph, "v1", "v2"))
    again = cut(path, "v3", "v4")
    assert again.original == kept and kept.read_bytes() == before
    assert not path.with_name(f"{path.name}.~1~").exists()


def test_a_file_of_that_name_that_is_not_ours_is_left_alone(path: Path) -> None:
    before, kept = path.read_bytes(), path.with_name(f"{path.name}~")
    kept.write_text("an editor's own copy")
    file = cut(path, "v0", "v1")
    assert kept.read_text() == "an editor's own copy"
    assert file.original == path.with_name(f"{path.name}.~1~") and file.original.read_bytes() == before


def test_a_link_of_that_name_is_not_written_through(path: Path, tmp_path: Path) -> None:
    letter = tmp_path / "letter.txt"
    letter.write_text("a letter")
    path.with_name(f"{path.name}~").symlink_to(letter)
    cut(path, "v0", "v1")
    assert letter.read_text() == "a letter"


def test_what_another_program_wrote_after_us_is_an_original_too(path: Path) -> None:
    first = path.read_bytes()
    cut(path, "v0", "v1")
    write_connectivity(row(7), path.parent)
    second = path.read_bytes()
    file = cut(path, "v5", "v6")
    assert path.with_name(f"{path.name}~").read_bytes() == first
    assert file.original is not None and file.original.read_bytes() == second


def test_nothing_is_kept_where_nothing_changes(path: Path) -> None:
    file = ForeignFile.open(path)
    file.save(file.graph)
    assert file.original is None and [p.name for p in path.parent.iterdir()] == [path.name]


def test_where_the_original_cannot_be_kept_nothing_is_saved(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = path.read_bytes()
    file = ForeignFile.open(path)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("nvsim.graph.foreign.file.keep_original", full)
    with pytest.raises(InputError, match="disk is full"):
        file.save(edits.remove_edge(file.graph, "v0", "v1"))
    assert path.read_bytes() == before and [p.name for p in path.parent.iterdir()] == [path.name]


def test_notes_that_name_an_original_elsewhere_are_not_believed(path: Path) -> None:
    review = path.with_name("house_review.json")
    atomic.write_text(review, json.dumps({"original": {"name": "../house.json", "written": "0"}}))
    assert ForeignFile.open(path).original is None


def test_the_words_name_the_original_and_the_islands(path: Path) -> None:
    file = cut(path, "v1", "v2")
    words = saving_message(path, file.original, file.graph)
    assert words.startswith("Saved house_connectivity.json. The original is kept as house_connectivity.json~.")
    assert words.endswith("The graph has 2 disconnected islands (3, 2 viewpoints).")
    assert disconnected_warning(row()) == ""


def nvsim(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "nvsim", *map(str, words)], capture_output=True, text=True, check=False, timeout=120
    )


def test_the_command_line_says_where_the_original_is(path: Path) -> None:
    before = path.read_bytes()
    done = nvsim("graph", "edit", path, "remove_edges", "--set", 'pairs=[["v1","v2"]]', "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert Path(told["original"]).read_bytes() == before and told["islands"] >= 2
    script = path.with_name("more.jsonl")
    script.write_text(json.dumps({"edit": "remove_edges", "pairs": [["v0", "v1"]]}) + "\n")
    replayed = nvsim("graph", "replay", path, script)
    assert f"The original file is kept as {path}~" in replayed.stdout and "islands" in replayed.stdout, replayed.stderr
    assert Path(f"{path}~").read_bytes() == before
