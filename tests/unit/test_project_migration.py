"""Projects that an older version wrote."""

from __future__ import annotations

import hashlib
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

from nvsim.graph.edits import ignore_finding, mark_reviewed, set_locked
from nvsim.graph.store import same_graph
from nvsim.project.earlier_results import describe
from nvsim.project.project import Project, layout_of
from nvsim.project.stages.imported import capture_config
from nvsim.project.state.results import StagePart, StageResult, UnfinishedPart

SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE stages (
    stage TEXT NOT NULL, part INTEGER NOT NULL, key TEXT NOT NULL, state TEXT NOT NULL,
    seconds REAL NOT NULL DEFAULT 0, finished REAL, summary TEXT NOT NULL DEFAULT '{}',
    PRIMARY KEY (stage, part));
CREATE TABLE submap_frames (submap INTEGER NOT NULL, frame INTEGER NOT NULL, core INTEGER NOT NULL,
    PRIMARY KEY (submap, frame));
CREATE TABLE viewpoints (
    seq INTEGER PRIMARY KEY, id TEXT NOT NULL UNIQUE, x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL,
    height REAL NOT NULL, submap INTEGER NOT NULL, included INTEGER NOT NULL, origin TEXT NOT NULL);
CREATE TABLE edges (seq INTEGER PRIMARY KEY, a TEXT NOT NULL, b TEXT NOT NULL, origin TEXT NOT NULL, UNIQUE (a, b));
CREATE TABLE evidence (
    seq INTEGER PRIMARY KEY, viewpoint TEXT NOT NULL, direction INTEGER NOT NULL, data BLOB NOT NULL,
    UNIQUE (viewpoint, direction));
CREATE TABLE jobs (
    id INTEGER PRIMARY KEY, stage TEXT NOT NULL, pid INTEGER NOT NULL, state TEXT NOT NULL, started REAL NOT NULL,
    updated REAL NOT NULL, finished REAL, done INTEGER NOT NULL DEFAULT 0, total INTEGER NOT NULL DEFAULT 0,
    message TEXT NOT NULL DEFAULT '');
CREATE TABLE results (name TEXT PRIMARY KEY, created REAL NOT NULL, figures TEXT NOT NULL);
"""
VERSION_2 = """
ALTER TABLE viewpoints ADD COLUMN reviewed INTEGER NOT NULL DEFAULT 0;
ALTER TABLE viewpoints ADD COLUMN locked INTEGER NOT NULL DEFAULT 0;
ALTER TABLE edges ADD COLUMN reviewed INTEGER NOT NULL DEFAULT 0;
ALTER TABLE edges ADD COLUMN locked INTEGER NOT NULL DEFAULT 0;
CREATE TABLE ignored (seq INTEGER PRIMARY KEY, key TEXT NOT NULL UNIQUE, reason TEXT NOT NULL);
"""
VERSION_3 = """
INSERT INTO meta VALUES ('scan', 'house');
INSERT INTO meta VALUES ('generation', '9');
INSERT INTO meta VALUES ('capture_config', '{"camera_height": 1.5, "hold_out": 4}');
INSERT INTO meta VALUES ('places', '{"imported": "imported", "cut/submaps": "cuts/2.npz", "masks": "masks.3",
    "floor": "floor.3", "cut/floors": "cuts/2.npz", "models/submap_000": "models/submap_000.4",
    "cut/train": "cuts/1.npz", "depth": "../outside", "models/submap_001": "models/none"}');
INSERT INTO meta VALUES ('batch train', '{"batch": "b", "submaps": [0]}');
INSERT INTO meta VALUES ('next train', '{"rows": {"1": {"key": "n", "seconds": 2.0, "finished": 50.0, "summary": {}}},
    "places": {"cut/train": "cuts/2.npz", "models/submap_001": "models/submap_001.5"}, "values": {}}');
INSERT INTO meta VALUES ('previous import', '{"rows": {"0": {"key": "i", "seconds": 1, "finished": 5.0, "summary":
    {"frames": 7, "worst": NaN}}}, "places": {"imported": "imported.1"}, "values": {"capture_config": "{}"}}');
INSERT INTO meta VALUES ('previous map', '{"rows": {"0": {"key": "m", "seconds": 1.0, "finished": 6.0, "summary":
    {"viewpoints": 2, "edges": 1}}}, "places": {}, "values": {"graph": "kept/graph.8"}}');
INSERT INTO meta VALUES ('previous depth', '{"rows": {}, "places": {}, "values": {"graph": 5}}');
INSERT INTO meta VALUES ('work train 0', '{"key": "w", "number": 9}');
INSERT INTO stages VALUES ('import', 0, 'k', 'done', 1.5, 10.0, '{"frames": 8}');
INSERT INTO stages VALUES ('submaps', 0, 'k', 'done', 0.5, 20.0, '{}');
INSERT INTO stages VALUES ('floors', 0, 'k', 'done', 0.5, NULL, '{}');
INSERT INTO stages VALUES ('floors', 1, 'k', 'done', 0.5, 9.0, '{}');
INSERT INTO stages VALUES ('train', 0, 'k', 'done', 0.5, 40.0, '{"steps": 12}');
INSERT INTO stages VALUES ('map', 0, 'half', 'running', 0, NULL, '{}');
INSERT INTO results VALUES ('graph', 60.0, '{"nodes": 2}');
"""


def third_version(folder: Path) -> Path:
    """A project as version 3 left it: the results of the stages as JSON in the table `meta`."""
    folder.mkdir()
    connection = sqlite3.connect(folder / "project.db")
    connection.executescript(f"BEGIN; {SCHEMA} {VERSION_2} {VERSION_3} PRAGMA user_version=3; COMMIT;")
    connection.close()
    return folder


def first_version(folder: Path) -> Path:
    """A project as version 1 left it: a graph without reviewed, locked and ignored."""
    folder.mkdir()
    connection = sqlite3.connect(folder / "project.db")
    connection.executescript(f"BEGIN; {SCHEMA} PRAGMA user_version=1; COMMIT;")
    connection.execute("INSERT INTO meta VALUES ('scan', 'old')")
    connection.executemany(
        "INSERT INTO viewpoints VALUES (?, ?, ?, 0, 1.5, 1.5, 0, 1, 'step')", [(0, "a", 0.0), (1, "b", 2.5)]
    )
    connection.execute("INSERT INTO edges VALUES (0, 'a', 'b', 'step')")
    connection.commit()
    connection.close()
    return folder


def test_an_older_project_is_read_as_it_is_and_brought_up_to_date_when_written(tmp_path: Path) -> None:
    path = first_version(tmp_path / "p.nvsim")
    with Project.open(path) as project:
        old = project.need_graph()
        assert list(old.edges) == [("a", "b")] and not old.viewpoints["a"].reviewed
    with Project.open(path, writable=True) as project:
        assert same_graph(project.need_graph(), old)
        graph = set_locked(mark_reviewed(old, ["a"], [("a", "b")]), edges=[("a", "b")])
        graph = ignore_finding(graph, "long a b", "a ramp")
        project.set_graph(graph)
    with Project.open(path) as project:
        assert same_graph(project.need_graph(), graph)
        assert project.need_graph().ignored == {"long a b": "a ramp"}


def check_results(project: Project) -> None:
    """Checks that the results are those of `third_version`."""
    found = project.stage_results()
    assert found.part("import") == StagePart(
        "k", 1.5, 10.0, '{"frames": 8}', "", '{"camera_height": 1.5, "hold_out": 4}'
    )
    assert capture_config(project).hold_out == 4
    assert found.part("train") == StagePart("k", 0.5, 40.0, '{"steps": 12}', batch="b")
    assert found.finished_stages == {"import", "submaps", "floors", "train"} and found.restorable_stages == {
        "import",
        "map",
    }
    assert found.outdated("k") == {"floors"} and found.stages_of_previous_cut == {"train"}
    assert found.places == {
        "imported": "imported",
        "cut/submaps": "cuts/2.npz",
        "masks": "masks.3",
        "floor": "floor.3",
        "cut/floors": "cuts/2.npz",
        "cut/train": "cuts/1.npz",
        "models/submap_000": "models/submap_000.4",
        "models/submap_001": "models/none",
    }
    assert found.get("next", "train") == StageResult(
        {1: StagePart("n", 2.0, 50.0)}, {"cut/train": "cuts/2.npz", "models/submap_001": "models/submap_001.5"}
    )
    former = found.get("previous", "import")
    assert former is not None and former.parts[0].settings == "{}" and former.files == {"imported": "imported.1"}
    assert describe(former, "import").startswith("the capture of 7 frames")
    kept = found.get("previous", "map")
    assert kept is not None and kept.files == {"graph": "kept/graph.8"}
    assert found.unfinished == {("train", 0): UnfinishedPart("w", 9), ("map", 0): UnfinishedPart("half")}
    assert found.generation == 9 and project.results() == {"graph": {"nodes": 2}}
    assert [key for (key,) in project.connection.execute("SELECT key FROM meta")] == ["scan"]


def test_results_of_version_3_are_the_same_for_readers_and_after_the_update(tmp_path: Path) -> None:
    path = third_version(tmp_path / "p.nvsim")
    before = hashlib.sha256((path / "project.db").read_bytes()).digest()
    with Project.open(path) as reader:
        check_results(reader)
        assert hashlib.sha256((path / "project.db").read_bytes()).digest() == before, "a reader changes nothing"
        assert layout_of(path).masks == path / "masks.3"
        revision = reader.revision()
        with Project.open(path, writable=True) as writer:
            check_results(writer)
        assert reader.revision() != revision
        check_results(reader)
    with Project.open(path) as project:
        check_results(project)


def test_a_kill_during_the_update_leaves_version_3(tmp_path: Path) -> None:
    path = third_version(tmp_path / "p.nvsim")
    code = (
        "import os, signal, pathlib\n"
        "from nvsim.project.state import database\n"
        "from nvsim.project.project import Project\n"
        "database.write = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n"
        f"Project.open(pathlib.Path({str(path)!r}), writable=True)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -signal.SIGKILL
    connection = sqlite3.connect(path / "project.db")
    assert connection.execute("PRAGMA user_version").fetchone() == (3,)
    assert connection.execute("SELECT count(*) FROM stages").fetchone() == (6,)
    connection.close()
    with Project.open(path, writable=True) as project:
        check_results(project)
