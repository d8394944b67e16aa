"""The stored history: the content on disk after closing, a kill, a second window, and a changed or damaged file."""

from __future__ import annotations

import contextlib
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.graph import edits
from nvsim.graph import journal as journal_module
from nvsim.graph.edits import EditError
from nvsim.graph.history import History
from nvsim.graph.journal import OUTSIDE, Journal, sidecar
from nvsim.graph.operations import perform_operation
from nvsim.graph.scripts import script
from nvsim.graph.selection import selection
from nvsim.graph.store import encode_graph, same_graph
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge


def row(count: int = 6) -> NavGraph:
    ids = [f"v{i}" for i in range(count)]
    viewpoints = {id: Viewpoint(id, (2.0 * i, i / 3, 1.5)) for i, id in enumerate(ids)}
    cells = np.arange(12, dtype=np.uint8).reshape(4, 3)
    found = [
        Evidence("v1", 8, 0.1, 2.0, cells, cells, cells > 3, 0.05, 0.1, 0.9, 0, (4.0, 0.5), "v2", "open"),
        Evidence("v4", 0, 0.1, 2.0, cells, cells, cells > 5, 0.05, 0.1, 0.9, 0, (4.0, 0.5), "", "alpha"),
    ]
    edges = {(a, b): edge(a, b) for a, b in zip(ids, ids[1:])}
    return NavGraph("row", viewpoints, edges, {e.key: e for e in found})


def edited(history: History) -> None:
    """Every kind of step: evidence dropped and marked stale, a drag, a selection, a finding ignored, an undo."""
    history.select(selection(["v2"], [("v1", "v2")]))
    for y in (1.0, 2.0, 3.0):
        perform_operation(history, "move_viewpoints", {"positions": {"v2": [4.0, y, 1.5]}}, merge="drag")
    perform_operation(history, "remove_viewpoints", {"ids": ["v4"]})
    perform_operation(history, "ignore_finding", {"key": "long v0", "reason": "a ramp"})
    perform_operation(history, "add_viewpoint", {"position": [1.0, 1.0, 1.5]})
    perform_operation(history, "rename_viewpoint", {"old": "v3", "new": "door"})
    history.undo()


def assert_same_history(a: History, b: History) -> None:
    assert [(s.text, s.selection, s.edit, s.merge, s.operation, s.when) for s in a.steps[1:]] == [
        (s.text, s.selection, s.edit, s.merge, s.operation, s.when) for s in b.steps[1:]
    ]
    assert a.index == b.index and a.is_saved == b.is_saved and a.selection == b.selection
    assert all(same_graph(a.graph_at(i), b.graph_at(i)) for i in range(len(a.steps)))


def test_history_comes_back_after_closing_with_every_graph(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        history = journal.history(row())
        edited(history)
    with Journal.open(path) as journal:
        again = journal.history(row())
        assert journal.recovered == 4 and not journal.notice
        assert_same_history(again, history)
        assert again.redo() and "door" in again.graph.viewpoints
        assert again.go_to(0) and same_graph(again.graph, row())


def test_steps_reach_the_disk_within_a_second_though_nobody_asks(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        history = journal.history(row())
        edited(history)
        deadline = time.monotonic() + 20  # a loaded machine; the period is 0.4 s
        while steps_on_disk(path) != len(history.steps) - 1:
            assert time.monotonic() < deadline
            time.sleep(0.05)


def steps_on_disk(path: Path) -> int:
    with contextlib.closing(sqlite3.connect(path)) as connection:
        try:
            return int(connection.execute("SELECT COUNT(*) FROM steps").fetchone()[0])
        except sqlite3.OperationalError:
            return 0  # no table yet


def test_what_is_saved_and_closed_goes_on_from_there(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        history = journal.history(row())
        edited(history)
        history.mark_saved()
        saved = history.graph
    with Journal.open(path) as journal:
        history = journal.history(saved)
        assert history.is_saved and journal.recovered == 0 and len(history.steps) > 3
        assert history.go_to(0) and not history.is_saved


def test_a_save_that_the_journal_did_not_hear_of_is_recognized(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        history = journal.history(row())
        edited(history)
    with Journal.open(path) as journal:
        again = journal.history(history.graph)
        assert again.is_saved and journal.recovered == 0 and len(again.steps) == len(history.steps)


def test_edits_after_a_save_that_was_not_heard_of_come_back_as_unsaved(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        history = journal.history(row())
        edited(history)
        saved = history.graph
        perform_operation(history, "remove_edges", {"pairs": [["v0", "v1"]]})
    with Journal.open(path) as journal:
        again = journal.history(saved)
        assert journal.recovered == 1 and not again.is_saved and again.undo_text == "Remove edge v0 – v1"
        again.undo()
        assert again.is_saved


def test_a_file_changed_outside_wins_and_what_was_unsaved_is_an_undo_away(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        history = journal.history(row())
        edited(history)
    other = edits.remove_viewpoints(row(), ["v0"])
    with Journal.open(path) as journal:
        again = journal.history(other)
        assert again.graph is other and again.is_saved and again.undo_text == OUTSIDE and journal.recovered == 4
        assert not again.steps[-1].edit
        again.undo()
        assert same_graph(again.graph, history.graph) and not again.is_saved
        again.redo()
    with Journal.open(path) as journal:
        once_more = journal.history(other)
        assert once_more.is_saved and len(once_more.steps) == len(again.steps), (
            "what was outside is outside after reopening"
        )
        assert once_more.steps[-1] == again.steps[-1]


def test_nothing_is_left_of_looking_and_of_a_foreign_file_saved_and_closed(tmp_path: Path) -> None:
    path = sidecar(tmp_path / "x_connectivity.json")
    with Journal.open(path, plain=True) as journal:
        journal.history(row()).select(selection(["v1"]))
    assert list(tmp_path.iterdir()) == []
    with Journal.open(path, plain=True) as journal:
        history = journal.history(row())
        perform_operation(history, "remove_edges", {"pairs": [["v0", "v1"]]})
    assert path.name in {p.name for p in tmp_path.iterdir()}, "unsaved edits stay"
    with Journal.open(path, plain=True) as journal:
        history = journal.history(row())
        assert journal.recovered == 1
        history.mark_saved()
    assert list(tmp_path.iterdir()) == []


def test_a_second_window_may_look_but_not_edit(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as first:
        history = first.history(row())
        edited(history)
        first.flush()
        with Journal.open(path) as second:
            seen = second.history(row())
            assert same_graph(seen.graph, history.graph)
            with pytest.raises(EditError, match="another window"):
                perform_operation(seen, "remove_edges", {"pairs": [["v0", "v1"]]})
            seen.select(selection(["v1"]))
        perform_operation(history, "remove_edges", {"pairs": [["v0", "v1"]]})
    with Journal.open(path) as third:
        assert_same_history(third.history(row()), history)


def test_a_damaged_journal_is_set_aside_and_said(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    path.write_bytes(b"no database at all" * 100)
    with Journal.open(path) as journal:
        history = journal.history(row())
        assert "damaged" in journal.notice and (tmp_path / "edits.db.damaged").exists()
        edited(history)
    with Journal.open(path) as journal:
        assert_same_history(journal.history(row()), history)


def test_a_journal_of_a_newer_program_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        edited(journal.history(row()))
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA user_version=99")
    with Journal.open(path) as journal, pytest.raises(InputError, match="newer NVSim"):
        journal.history(row())
    assert path.exists()


def test_what_the_disk_refused_is_kept_and_written_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        history = journal.history(row())

        def full(*_: object) -> None:
            raise InputError("Cannot write: the disk is full.")

        with monkeypatch.context() as m:
            m.setattr(journal._file, "write", full)
            edited(history)
            with pytest.raises(InputError, match="full"):
                journal.flush()
            assert "full" in journal.trouble
            history.redo()
        journal.flush()
        assert journal.trouble == ""
    with Journal.open(path) as journal:
        assert_same_history(journal.history(row()), history)


def test_a_killed_process_leaves_the_journal_to_the_next(tmp_path: Path) -> None:
    program = f"""
import os, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from pathlib import Path
from test_graph_journal import edited, row
from nvsim.graph.journal import Journal
journal = Journal.open(Path({str(tmp_path / "edits.db")!r}))
edited(journal.history(row()))
journal.flush()
os.kill(os.getpid(), 9)
"""
    assert subprocess.run([sys.executable, "-c", program]).returncode == -9
    with Journal.open(tmp_path / "edits.db") as journal:
        history = journal.history(row())
        assert journal.recovered == 4 and journal.refusal is None and len(history.steps) == 7


def test_a_script_does_again_what_was_done(tmp_path: Path) -> None:
    from nvsim.graph.operations import apply, parse_line

    history = History(row())
    edited(history)
    again = edits.split_edge(history.graph, "v0", "v1")
    history.perform("Something without a name", edits.remove_viewpoints(again, ["v5"]))
    both = [{"edit": "lock", "viewpoints": ["v0"]}, {"edit": "mark_reviewed", "viewpoints": ["v0"]}]
    perform_operation(history, "together", {"edits": both, "text": "Done with v0"})
    assert history.undo_text == "Done with v0"
    graph = row()
    for line in script(history):
        graph = apply(graph, *parse_line(line))
    assert same_graph(graph, history.graph)


def many(history: History, count: int) -> None:
    """Steps one after another, a rename and a selection among them."""
    for i in range(count):
        if i % 7 == 3:
            history.select(selection([f"v{i % 3}"]))
        elif i % 7 == 5:
            old = list(history.graph.viewpoints)[5]
            perform_operation(history, "rename_viewpoint", {"old": old, "new": f"n{i}"})
        else:
            perform_operation(history, "move_viewpoints", {"positions": {"v1": [2.0, 0.1 * i, 1.5]}})


@pytest.mark.parametrize("by", ["steps", "bytes"])
def test_a_long_journal_keeps_its_last_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by: str) -> None:
    path = tmp_path / "edits.db"
    if by == "steps":
        monkeypatch.setattr(journal_module, "KEPT_STEPS", 12)
    else:
        monkeypatch.setattr(journal_module, "KEPT_BYTES", 1500)
    with Journal.open(path) as journal:
        history = journal.history(row())
        many(history, 40)
        history.mark_saved()
        many(history, 3)
        history.undo()
        saved = history.graph_at(history.saved_index)
    with Journal.open(path) as journal:
        again = journal.history(saved)
        kept = len(again.steps) - 1
        assert kept == 12 if by == "steps" else 2 <= kept < 30
        assert [s.text for s in again.steps[1:]] == [s.text for s in history.steps[-kept:]]
        gone = len(history.steps) - len(again.steps)
        assert again.index == history.index - gone and again.saved_index == history.saved_index - gone
        assert journal.recovered == history.edits_since_saved() and not journal.notice
        for i in range(kept + 1):
            assert same_graph(again.graph_at(i), history.graph_at(i + gone))
        while again.undo():
            pass
        assert same_graph(again.graph, history.graph_at(gone))


def test_a_journal_is_trimmed_down_to_the_current_step_and_no_further(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        history = journal.history(row())
        many(history, 40)
        history.go_to(5)
    monkeypatch.setattr(journal_module, "KEPT_STEPS", 4)
    with Journal.open(path) as journal:
        again = journal.history(row())
        assert len(again.steps) == len(history.steps) - 4 and again.index == 1
        assert again.saved_index == -1 and not again.is_saved  # what the file holds is before the first step now
        assert same_graph(again.graph, history.graph)


def test_a_kill_in_the_middle_of_trimming_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        history = journal.history(row())
        many(history, 60)
    program = f"""
import os, sys
from pathlib import Path
import nvsim.graph.journal_file as trimming
from nvsim.graph import journal
from nvsim.graph.journal_file import JournalFile
at = int(sys.argv[1])
class Killing:
    def __init__(self, connection): self.connection, self.count = connection, 0
    def __getattr__(self, name):
        def call(*arguments):
            self.count += 1
            if self.count > at:
                os.kill(os.getpid(), 9)
            return getattr(self.connection, name)(*arguments)
        return call
file = JournalFile(Path({str(path)!r}))
trimming.trim(Killing(file._open()), 10, 1 << 30)
print("through")
"""
    for at in range(4, 14):
        done = subprocess.run([sys.executable, "-c", program, str(at)], capture_output=True, text=True)
        with Journal.open(path) as journal:
            again = journal.history(row())
            assert not journal.notice
            assert same_graph(again.graph, history.graph)
            assert len(again.steps) in (len(history.steps), 11)
            if done.returncode == 0:
                break
            assert done.returncode == -9, done.stderr
    else:
        pytest.fail("it never came to an end")
    assert len(again.steps) == 11 and at > 8


def test_a_trimmed_journal_gives_its_room_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "edits.db"
    cells = np.random.default_rng(0).integers(0, 255, (60, 90)).astype(np.uint8)
    graph = row()
    with Journal.open(path) as journal:
        history = journal.history(graph)
        for i in range(400):
            e = Evidence("v1", 8, 0.1, 2.0, cells + np.uint8(i % 200), cells, cells > 3, 0.05, 0.1, 0.9, 0, (4.0, 0.5))
            history.perform(f"Measure {i}", replace(history.graph, evidence={e.key: e}))
    size = path.stat().st_size
    assert size > 3 << 20
    monkeypatch.setattr(journal_module, "KEPT_BYTES", 1 << 20)
    Journal.open(path).close()
    assert path.stat().st_size < 0.6 * size
    with Journal.open(path) as journal:
        assert same_graph(journal.history(graph).graph, history.graph)


def test_a_step_that_an_earlier_program_stored_whole_is_read(tmp_path: Path) -> None:
    path = tmp_path / "edits.db"
    with Journal.open(path) as journal:
        history = journal.history(row())
        perform_operation(history, "rename_viewpoint", {"old": "v3", "new": "door"})
        perform_operation(history, "remove_viewpoints", {"ids": ["v1"]})
    connection = sqlite3.connect(path)
    connection.execute("UPDATE steps SET delta = ? WHERE number = 1", (b"W" + encode_graph(history.graph_at(1)),))
    connection.execute("PRAGMA user_version = 1")
    connection.commit()
    connection.close()
    with Journal.open(path) as journal:
        again = journal.history(row())
        assert same_graph(again.graph, history.graph) and same_graph(again.graph_at(1), history.graph_at(1))
