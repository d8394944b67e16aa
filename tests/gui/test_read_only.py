"""A project can be viewed on a full disk, in a read-only folder, or after its process was killed."""

from __future__ import annotations

import ctypes
import json
import os
import resource
import signal
import sqlite3
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import demo_project
import pytest

from nvsim.errors import InputError
from nvsim.files import databases
from nvsim.project.layout import Layout
from nvsim.project.project import Project

_LOOK = """
import json, sys
from pathlib import Path
from PySide6.QtCore import QCoreApplication
from nvsim_app.state.document import Document
from nvsim_app.state.loading import ProjectReader
from nvsim.errors import InputError
from nvsim.project.project import Project

application = QCoreApplication([])
path = Path(sys.argv[1])
said = []
document = Document()
document.editing.notified.connect(said.append)
document.editing.failed.connect(said.append)
reader = ProjectReader(path)
for contents in reader.updates():
    document.set_contents(contents)
editing = document.editing
edge = list(next(iter(document.graph.edges)))
edited = editing.run("remove_edges", {"pairs": [edge]})
try:
    Project.open(path, writable=True).close()
    refusal = ""
except InputError as error:
    refusal = str(error)
print(json.dumps({
    "scan": document.graph.scan, "edges": len(document.graph.edges), "locked": editing.locked, "said": said,
    "edited": edited, "refusal": refusal,
}))
sys.stdout.flush()
document.editing.close()
reader.close()
"""
_DAC_OVERRIDE, _DAC_READ_SEARCH, _DROP = 1, 2, 24


def bound_by_permissions() -> None:
    """Root, too, may write only where the permissions say so, from the next program on."""
    libc = ctypes.CDLL(None)
    for capability in (_DAC_OVERRIDE, _DAC_READ_SEARCH):
        libc.prctl(_DROP, capability, 0, 0, 0)


def no_room() -> None:
    """No file of this process can grow, as if the disk were full."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))


def looked_at(project: Path, when: Callable[[], None]) -> dict[str, object]:
    """The content that a window finds in the project. It runs in a child process that `when` delays."""
    result = subprocess.run(
        [sys.executable, "-c", _LOOK, str(project)], preexec_fn=when, capture_output=True, timeout=120, check=False
    )
    lines = result.stdout.decode().splitlines()
    assert lines, result.stderr.decode()
    found: dict[str, object] = json.loads(lines[-1])
    return found


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return demo_project.write_project(tmp_path / "demo.nvsim", models=0)


@pytest.fixture
def left_by_a_kill(project: Path) -> Path:
    """The last commit is only in SQLite's log beside the database."""
    program = (
        "import os, sys; from pathlib import Path; from dataclasses import replace;"
        "from nvsim.project.project import Project;"
        "p = Project.open(Path(sys.argv[1]), writable=True);"
        "p.set_graph(replace(p.need_graph(), scan='committed')); os._exit(9)"
    )
    subprocess.run([sys.executable, "-c", program, str(project)], check=False)
    assert (project / "project.db-wal").stat().st_size > 0
    return project


@pytest.fixture
def protected() -> Iterator[Callable[[Path], Path]]:
    done: list[Path] = []

    def protect(folder: Path) -> Path:
        done.append(folder)
        folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
        return folder

    yield protect
    for folder in done:
        folder.chmod(stat.S_IRWXU)


def test_a_folder_that_cannot_be_written_is_looked_at_and_says_so(
    project: Path, protected: Callable[[Path], Path]
) -> None:
    with Project.open(project) as opened:
        edges = len(opened.need_graph().edges)
    found = looked_at(protected(project), bound_by_permissions)
    assert found["edges"] == edges and found["edited"] is False
    assert "is read-only" in str(found["locked"]) and "permission is denied" in str(found["locked"])
    assert found["locked"] in list(found["said"])  # type: ignore[call-overload]
    assert "permission is denied" in str(found["refusal"])


def test_what_a_killed_writer_committed_is_seen_where_nothing_can_be_written(
    left_by_a_kill: Path, protected: Callable[[Path], Path]
) -> None:
    (left_by_a_kill / "project.db-shm").unlink()
    before = {path.name: path.read_bytes() for path in left_by_a_kill.iterdir() if path.is_file()}
    found = looked_at(protected(left_by_a_kill), bound_by_permissions)
    assert found["scan"] == "committed" and found["locked"]
    assert {path.name: path.read_bytes() for path in left_by_a_kill.iterdir() if path.is_file()} == before


@pytest.mark.parametrize("history", [False, True])
def test_a_project_on_a_full_disk_can_be_looked_at(project: Path, history: bool) -> None:
    if history:
        from nvsim.graph.journal import Journal
        from nvsim.graph.operations import perform_operation
        from nvsim_app.state.graph_files import ProjectGraph

        with Project.open(project) as opened:
            graph = opened.need_graph()
        with Journal.open(Layout(project).edits) as journal:
            steps = journal.history(graph)
            perform_operation(steps, "remove_edges", {"pairs": [list(next(iter(graph.edges)))]})
        assert ProjectGraph(project).journal is not None
    with Project.open(project) as opened:
        scan = opened.need_graph().scan
    found = looked_at(project, no_room)
    assert found["scan"] == scan and found["edited"] is False
    assert found["said"] == [found["locked"]] and "is read-only" in str(found["locked"])
    assert str(found["refusal"]).startswith("Cannot write")


def test_a_snapshot_follows_what_others_write_later(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:

    usual = databases._try_open

    def no_shared_memory(path: Path, flags: str, kind: type[sqlite3.Connection]) -> sqlite3.Connection:
        if "immutable" not in flags:
            raise sqlite3.OperationalError("unable to open database file")
        return usual(path, flags, kind)

    monkeypatch.setattr(databases, "_try_open", no_shared_memory)
    opened = Project.open(project)
    monkeypatch.undo()
    first = opened.revision()
    assert isinstance(opened.connection, databases.Snapshot) and opened.revision() == first
    with Project.open(project, writable=True) as writer:
        writer.set_result("graph", {"nodes": 2})
    assert opened.revision() != first
    assert opened.results() and not isinstance(opened.connection, databases.Snapshot)
    opened.close()


def test_a_snapshot_cannot_be_written(left_by_a_kill: Path) -> None:
    from nvsim.files.databases import _copy_to_memory

    copy = _copy_to_memory(Layout(left_by_a_kill).database)
    with pytest.raises(sqlite3.OperationalError, match="readonly"):
        copy.execute("DELETE FROM meta")
    copy.close()


def test_a_damaged_database_is_still_said_to_be_damaged(project: Path) -> None:
    Layout(project).database.write_bytes(b"nothing of the kind" * 100)
    with pytest.raises(InputError, match="damaged"):
        Project.open(project)
    assert os.path.getsize(Layout(project).database) == 1900
