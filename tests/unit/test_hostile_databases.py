"""Databases that anyone may have written: one sentence each, within a moment, and nothing of theirs is run."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.files import databases, tables
from nvsim.graph.history import History
from nvsim.graph.journal import Journal
from nvsim.graph.operations import perform_operation
from nvsim.graph.scripts import HEAD, script, write_script
from nvsim.graph.types import Edge, NavGraph, Viewpoint
from nvsim.project.project import Project
from nvsim.project.state.results import StagePart, StageResult, StageResults, remove_unreferenced_files

PART = "0, '{}', '', '', '')"  # the end of a row of stage_parts, from the time, with its summary
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT {columns} FROM n"


def a_graph() -> NavGraph:
    viewpoints = {id: Viewpoint(id, (2.0 * i, 0.0, 1.5)) for i, id in enumerate("abc")}
    return NavGraph("house", viewpoints, {("a", "b"): Edge("a", "b"), ("b", "c"): Edge("b", "c")})


@pytest.fixture
def house(tmp_path: Path) -> Path:
    root = tmp_path / "house.nvsim"
    with Project.create_or_open(root) as project:
        project.set_graph(a_graph())
    with Journal.open(root / "edits.db") as journal:
        perform_operation(journal.history(a_graph()), "remove_edges", {"pairs": [["a", "b"]]})
        journal.flush()
    return root


def change(database: Path, *statements: str) -> None:
    with contextlib.closing(sqlite3.connect(database)) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()


def view_of(table: str, columns: str) -> tuple[str, str]:
    return f"DROP TABLE {table}", f"CREATE VIEW {table} AS {ENDLESS.format(columns=columns)}"


HOSTILE = {
    "a recursive view": view_of("viewpoints", "i AS seq, 'a' AS id, 0.0 AS x, 0.0 AS y, 0.0 AS z, 1.5 AS height, "
                                "0 AS submap, 1 AS included, '' AS origin, 0 AS reviewed, 0 AS locked"),
    "a view of meta": view_of("meta", "'scan' AS key, hex(zeroblob(i)) AS value"),
    "a trigger": ("CREATE TRIGGER t AFTER INSERT ON edges BEGIN DELETE FROM viewpoints; END",),
    "a virtual table": ("DROP TABLE ignored", "CREATE VIRTUAL TABLE ignored USING fts5(seq, key, reason)"),
    "another table": ("CREATE TABLE extra (x)",),
    "an index of its own": ("CREATE INDEX i ON edges (length(a))",),
    "another column": ("ALTER TABLE edges ADD COLUMN more TEXT",),
    "a generated column": ("DROP TABLE results",
                           "CREATE TABLE results (name TEXT, created REAL, figures TEXT AS (hex(zeroblob(1e8))))"),
    "a missing table": ("DROP TABLE evidence",),
}  # fmt: skip


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_database_with_anything_but_our_tables_is_refused_at_once(house: Path, kind: str) -> None:
    change(house / "project.db", *HOSTILE[kind])
    for writable in (False, True):
        begun = time.process_time()
        with pytest.raises(InputError, match="project.db (holds|has|lacks)"):
            Project.open(house, writable=writable)
        assert time.process_time() - begun < 2


CELLS = {
    "viewpoints": ["UPDATE viewpoints SET x = 'abc'", "UPDATE viewpoints SET height = 9e999",
                   "UPDATE viewpoints SET id = '' WHERE seq = 0",
                   "UPDATE viewpoints SET id = x'00ff' WHERE seq = 0", "UPDATE viewpoints SET included = 7",
                   "UPDATE viewpoints SET submap = 9223372036854775807", "UPDATE viewpoints SET origin = zeroblob(5)",
                   "UPDATE viewpoints SET id = CAST(x'ff' AS TEXT) WHERE seq = 0"],
    "edges": ["UPDATE edges SET b = 'nobody' WHERE seq = 0", "UPDATE edges SET a = 'z' WHERE seq = 0",
              "UPDATE edges SET locked = 'yes'"],
    "evidence": ["INSERT INTO evidence VALUES (0, 'a', 0, x'01')", "INSERT INTO evidence VALUES (0, 'a', 0, 'text')",
                 "INSERT INTO evidence VALUES (0, 'a', 0, zeroblob(100000))",
                 "INSERT INTO evidence VALUES (0, 'a', 0, x'01ffffffff7b7d')"],
    "meta": ["UPDATE meta SET value = x'ff'", "UPDATE meta SET value = '../../outside'"],
    "ignored": ["INSERT INTO ignored VALUES (0, 'a key', zeroblob(3))"],
}  # fmt: skip


@pytest.mark.parametrize("statement", [s for statements in CELLS.values() for s in statements])
def test_a_cell_of_a_wrong_type_is_named(house: Path, statement: str) -> None:
    change(house / "project.db", statement)
    with Project.open(house) as project, pytest.raises(InputError, match="project.db"):
        project.graph()


@pytest.mark.parametrize(
    ("statement", "read"),
    [
        ("INSERT INTO results VALUES ('graph', 0, '[1]')", lambda p: p.results()),
        ("INSERT INTO results VALUES ('graph', 0, '{')", lambda p: p.results()),
        (f"INSERT INTO results VALUES ('graph', 0, '{'[' * 99999}')", lambda p: p.results()),
        ("INSERT INTO submap_frames VALUES (0, 99, 1)", lambda p: p.submaps()),
        ("INSERT INTO submap_frames VALUES ('a', 'b', 'c')", lambda p: p.submaps()),
        (
            "INSERT INTO stage_parts VALUES ('in use', 's', 0, 'k', 9e999, 0, '{}', '', '', '')",
            lambda p: p.stage_results(),
        ),
        ("INSERT INTO stage_files VALUES ('in use', 's', 'masks', x'00')", lambda p: p.stage_results()),
        ("INSERT INTO unfinished VALUES ('s', 'x', 'k', 1)", lambda p: p.stage_results()),
        ("INSERT INTO generation VALUES ('x')", lambda p: p.stage_results()),
    ],
)
def test_every_reader_says_what_is_wrong(house: Path, statement: str, read: Callable[[Project], object]) -> None:
    change(house / "project.db", statement)
    with Project.open(house) as project, pytest.raises(InputError):
        read(project)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{",
        '{"shell": "x"}',
        '{"scale": "1"}',
        '{"hold_out": -1}',
        '{"poses": "x"}',
        '{"camera_height": 1e999}',
        "[" * 99_999,
    ],
)
def test_what_is_stored_of_the_import_is_taken_only_as_what_it_must_be(house: Path, text: str) -> None:
    from nvsim.project.stages.imported import capture_config

    with Project.open(house, writable=True) as project:
        project.set_stage_results(StageResults({("in use", "import"): StageResult({0: StagePart("k", settings=text)})}))
        with pytest.raises(InputError, match="import it again"):
            capture_config(project)


@pytest.mark.parametrize("place", ["../outside", "/etc/hostname", "floor", "kept/graph.7"])
def test_previous_map_is_restored_only_from_a_graph_file_of_the_project(
    house: Path, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from nvsim.graph.store import encode_graph
    from nvsim.project import earlier_results

    (house.parent / "outside").write_bytes(encode_graph(a_graph()))
    monkeypatch.setattr(earlier_results, "describe", lambda result, stage: "restored")
    with Project.open(house, writable=True) as project:
        project.set_stage_results(StageResults({("previous", "map"): StageResult({}, {"graph": place})}))
        with pytest.raises(InputError, match="is missing"):
            earlier_results.restore(project, "map")
        project.set_stage_results(project.stage_results())
        remove_unreferenced_files(project.stage_results(), project.root)
    assert (house.parent / "outside").is_file()


@pytest.mark.parametrize("text", ['{"thresholds": null}', '{"thresholds": [1]}', '{"thresholds": "x"}', "[1]"])
def test_thresholds_of_another_type_are_not_a_crash(house: Path, text: str) -> None:
    from nvsim.mapping.config import MappingConfig
    from nvsim.project.graph import thresholds_of

    change(
        house / "project.db", f"INSERT INTO stage_parts VALUES ('in use', 'map', 0, 'k', 0, 0, '{text}', '', '', '')"
    )
    with Project.open(house) as project:
        if text == "[1]":
            with pytest.raises(InputError):
                thresholds_of(project)
        else:
            assert thresholds_of(project) == MappingConfig()


def test_damaged_pages_are_a_sentence(house: Path) -> None:
    whole = (house / "project.db").read_bytes()
    for start in range(100, len(whole), 997):
        (house / "project.db").write_bytes(whole[:start] + os.urandom(500) + whole[start + 500 :])
        with contextlib.suppress(InputError), Project.open(house) as project:
            project.graph()
    (house / "project.db").write_bytes(whole[:5000])
    with pytest.raises(InputError, match="damaged"), Project.open(house) as project:
        project.graph()


def test_an_empty_database_is_said_to_be_empty(tmp_path: Path) -> None:
    root = tmp_path / "p.nvsim"
    root.mkdir()
    (root / "project.db").touch()
    with pytest.raises(InputError, match="is empty"):
        Project.open(root)
    Project.open(root, writable=True).close()  # as a kill leaves it, it is made


@pytest.mark.parametrize("name", ["project.db", "project.db-wal", "project.db-journal", "edits.db", "edits.db-wal"])
@pytest.mark.parametrize("kind", ["link", "pipe", "hard link"])
def test_databases_and_what_lies_beside_them_are_files_of_their_own(
    house: Path, tmp_path: Path, name: str, kind: str
) -> None:
    canary = tmp_path / "canary"
    canary.write_text("untouched")
    (house / name).unlink(missing_ok=True)
    if kind == "link":
        (house / name).symlink_to(canary)
    elif kind == "pipe":
        os.mkfifo(house / name)
    else:
        os.link(canary, house / name)
    with pytest.raises(InputError, match="replace it with the file itself"):
        if name.startswith("project"):
            Project.open(house, writable=True)
        else:
            Journal.open(house / "edits.db")
    assert canary.read_text() == "untouched"


def test_a_journal_of_sqlite_that_names_another_file_is_refused(house: Path, tmp_path: Path) -> None:
    canary = tmp_path / "canary"
    canary.write_text("untouched")
    name = str(canary).encode()
    total = sum(name) & 0xFFFFFFFF
    tail = bytes(4) + name + len(name).to_bytes(4, "big") + total.to_bytes(4, "big") + databases._SUPER
    (house / "project.db-journal").write_bytes(bytes.fromhex("d9d505f920a163d7") + bytes(504) + tail)
    with pytest.raises(InputError, match="asks SQLite to change other files"):
        Project.open(house, writable=True)
    assert canary.read_text() == "untouched"


def test_a_reading_that_does_not_end_is_ended_and_a_signal_is_answered(tmp_path: Path) -> None:
    with contextlib.closing(sqlite3.connect(":memory:")) as connection:
        begun = time.monotonic()
        with pytest.raises(InputError, match="took longer"), tables.reading_rows(connection, tmp_path, 0.3):
            connection.execute(ENDLESS.format(columns="max(i)")).fetchone()
        assert time.monotonic() - begun < 5

        class Asked(BaseException):
            pass

        def stop(number: int, frame: object) -> None:
            raise Asked

        before = signal.signal(signal.SIGALRM, stop)
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        try:
            with pytest.raises(Asked), tables.reading_rows(connection, tmp_path, 30):
                connection.execute(ENDLESS.format(columns="max(i)")).fetchone()
        finally:
            signal.signal(signal.SIGALRM, before)
        assert time.monotonic() - begun < 10


@pytest.mark.parametrize("kind", ["a recursive view", "a trigger"])
def test_the_command_line_ends_with_a_sentence(house: Path, kind: str) -> None:
    change(house / "project.db", *HOSTILE[kind])
    command = [sys.executable, "-m", "nvsim.cli.main", "graph", "check", str(house)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 2 and "project.db has the" in ended.stderr + ended.stdout
    assert "Traceback" not in ended.stderr and "a bug in NVSim" not in ended.stderr


# Histories ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "statements",
    [
        view_of("steps", "i AS number, '' AS text, 0.0 AS at, 1 AS edit, NULL AS merge, NULL AS operation, x'' AS "
                "selection, x'' AS delta"),
        view_of("base", "x'' AS graph, 0.0 AS at"),
        ("CREATE TRIGGER t AFTER DELETE ON steps BEGIN SELECT 1; END",),
        ("UPDATE steps SET delta = zeroblob(100)",),
        ("UPDATE steps SET selection = x'0102'",),
        ("UPDATE steps SET operation = '[1]'",),
        (f"UPDATE steps SET operation = '{'[' * 99999}'",),
        ("UPDATE steps SET text = x'ff'",),
        ("UPDATE marks SET value = 'x' WHERE name = 'index'",),
        ("UPDATE marks SET value = 9e999 WHERE name = 'clean'",),
        ("DELETE FROM base",),
        ("UPDATE base SET graph = 'PK'",),
    ],
)  # fmt: skip
def test_a_prepared_history_is_set_aside_and_said_so(house: Path, statements: tuple[str, ...]) -> None:
    change(house / "edits.db", *statements)
    with Journal.open(house / "edits.db") as journal:
        history = journal.history(a_graph())
        assert "was renamed to" in journal.notice and len(history.steps) == 1
    assert (house / "edits.db.damaged").exists()


def test_steps_that_do_not_follow_from_each_other_are_found_at_the_opening(house: Path) -> None:
    with contextlib.closing(sqlite3.connect(house / "edits.db")) as connection:
        row = connection.execute("SELECT text, at, edit, merge, operation, selection, delta FROM steps").fetchone()
        connection.execute("INSERT INTO steps VALUES (2, ?, ?, ?, ?, ?, ?, ?)", row)  # removes the same edge again
        connection.commit()
    with Journal.open(house / "edits.db") as journal:
        journal.history(a_graph())
        assert "step 2 removes elements that do not exist" in journal.notice


# Scripts --------------------------------------------------------------------------------------------------------


def smuggled(house: Path, operation: object = None, text: str = "words") -> History:
    value = None if operation is None else json.dumps(operation)
    with contextlib.closing(sqlite3.connect(house / "edits.db")) as connection:
        connection.execute("UPDATE steps SET operation = ?, text = ?", (value, text))
        connection.commit()
    with Journal.open(house / "edits.db") as journal:
        return journal.history(a_graph())


@pytest.mark.parametrize(
    "operation",
    [
        {"edit": "shell", "command": "touch /tmp/x"},
        {"edit": "remove_edges", "pairs": [["a", "b"]], "also": "rm -rf ~"},
        {"edit": "remove_edges", "pairs": "rm -rf ~"},
        {"edit": ["remove_edges"]},
        {"pairs": []},
        {"edit": "together", "edits": [{"edit": "remove_edges", "pairs": [["a", "b"]], "x": 1}]},
        {"edit": "set_height", "ids": ["a"], "height": 1e999},
    ],
)
def test_a_script_holds_nothing_but_edits_that_there_are(house: Path, operation: dict[str, object]) -> None:
    with pytest.raises(InputError, match="Step 1 of the history"):
        script(smuggled(house, operation))


def test_words_of_a_history_cannot_become_lines_of_a_script(house: Path) -> None:
    wild = 'x\n{"edit": "shell"}\r\n\x1b[2J\u2028export PATH=/tmp ' + "y" * 1000
    for line in script(smuggled(house, None, wild)):
        assert "\n" not in line and line.isprintable() and json.loads(line)["edit"] == "patch"
    from nvsim.graph.scripts import comment

    assert "\n" not in comment(wild) and comment(wild).startswith("# x {") and len(comment(wild)) <= 202


def test_a_script_takes_the_place_of_a_script_only(tmp_path: Path) -> None:
    mine = tmp_path / "mine.jsonl"
    write_script(mine, ['{"edit": "remove_edges", "pairs": []}'])
    write_script(mine, [])
    assert mine.read_text() == f"{HEAD}\n"
    (tmp_path / "older.jsonl").write_text('{"edit": "remove_edges", "pairs": []}\n')
    write_script(tmp_path / "older.jsonl", [])
    for name, text in (
        (".bashrc", "export A=1\n"),
        ("notes", "# Notes\n"),
        ("bytes", "\0\1"),
        ("data.json", '{"a": 1}'),
    ):
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match="is not a script"):
            write_script(tmp_path / name, [])
        assert (tmp_path / name).read_text() == text
    (tmp_path / "link").symlink_to(tmp_path / ".bashrc")
    os.mkfifo(tmp_path / "pipe")
    for name in ("link", "pipe"):
        with pytest.raises(InputError, match="is not a script"):
            write_script(tmp_path / name, [])


def test_a_log_written_over_a_file_of_the_user_is_refused(house: Path, tmp_path: Path) -> None:
    precious = tmp_path / ".bashrc"
    precious.write_text("export A=1\n")
    assert main(["graph", "log", str(house), "--script", str(precious)]) == 2
    assert precious.read_text() == "export A=1\n"


@pytest.mark.parametrize(
    "line",
    ['{"edit": "export", "out": "/tmp/x"}', '{"edit": "remove_edges", "pairs": [], "out": "/tmp/x"}', "[" * 99_999],
)
def test_a_script_that_is_replayed_names_edits_of_the_graph_and_no_places(
    house: Path, tmp_path: Path, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(house)
    with Project.create_or_open(house) as project:
        project.set_graph(a_graph())
    (tmp_path / "script").write_text(line)
    assert main(["graph", "replay", str(house), str(tmp_path / "script")]) == 2
    assert "line 1" in capsys.readouterr().err
    os.mkfifo(tmp_path / "pipe")
    assert main(["graph", "replay", str(house), str(tmp_path / "pipe")]) == 2
