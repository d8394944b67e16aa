"""The project on disk: one writer, honest refusals, values in and out."""

import sqlite3
import subprocess
import sys

import pytest

from nvsim.errors import InputError
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig, held_out
from nvsim.project.project import Project


@pytest.fixture
def project(tmp_path):
    with Project.create_or_open(tmp_path / "house.nvsim") as opened:
        yield opened


def test_a_second_writer_is_refused_and_a_reader_is_not(project):
    with pytest.raises(InputError, match="being written"):
        Project.open(project.layout.root, writable=True)
    with Project.open(project.layout.root) as reader:
        assert reader.graph() is None


def test_the_lock_of_a_killed_writer_is_free(tmp_path):
    root = tmp_path / "house.nvsim"
    code = (
        "import os, signal, pathlib; from nvsim.project.project import Project\n"
        f"p = Project.create_or_open(pathlib.Path({str(root)!r})); os.kill(os.getpid(), signal.SIGKILL)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -9
    with Project.open(root, writable=True):
        pass


def test_a_project_of_a_newer_version_is_refused(project):
    root = project.layout.root
    project.connection.execute("PRAGMA user_version=99")
    project.close()
    for writable in (False, True):
        with pytest.raises(InputError, match="newer NVSim"):
            Project.open(root, writable=writable)


def test_folders_that_are_no_projects_are_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        Project.open(tmp_path / "nowhere")
    with pytest.raises(InputError, match="not an NVSim project"):
        Project.open(tmp_path)
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(InputError, match=r"holds other files \(thesis.tex\)"):
        Project.create_or_open(tmp_path)


def test_a_damaged_database_is_refused(project):
    root = project.layout.root
    project.close()
    for extra in root.glob("project.db-*"):
        extra.unlink()
    (root / "project.db").write_bytes(b"not a database at all" * 300)
    with pytest.raises(InputError, match="damaged"):
        Project.open(root)


def test_a_kill_between_creation_and_schema_leaves_a_project_that_opens(tmp_path):
    root = tmp_path / "house.nvsim"
    root.mkdir()
    sqlite3.connect(root / "project.db").close()
    with Project.create_or_open(root) as project:
        project.set_result("graph", {"nodes": 2})
        assert project.results() == {"graph": {"nodes": 2}}


def test_a_graph_comes_back_in_order(project):
    ids = ["f" * 32, "0" * 32, "a" * 32]
    viewpoints = {i: Viewpoint(i, (n + 0.25, 2.0, 1.5), 1.25, n, n != 1, "step") for n, i in enumerate(ids)}
    edges = {e.key: e for e in (edge(ids[0], ids[1], "merge"), edge(ids[2], ids[1]))}
    project.set_graph(NavGraph("house", viewpoints, edges))
    graph = project.need_graph()
    assert list(graph.viewpoints.items()) == list(viewpoints.items())
    assert list(graph.edges.items()) == list(edges.items())
    assert graph.scan == "house"


def test_a_transaction_is_all_or_nothing(project):
    with pytest.raises(RuntimeError), project.transaction() as c:
        c.execute("INSERT INTO results VALUES ('half', 0, '{}')")
        raise RuntimeError
    assert project.results() == {}


def test_a_stage_is_current_only_for_the_inputs_it_finished_with(project):
    key = ledger.key_of("train", CaptureConfig(), (1, 2))
    assert key != ledger.key_of("train", CaptureConfig(hold_out=0), (1, 2))
    assert not ledger.begin_part(project, "train", key, 3)
    assert not ledger.is_current(project, "train", key, 3)
    assert ledger.begin_part(project, "train", key, 3)  # a second beginning continues the first
    ledger.finish(project, "train", 1.5, {"gaussians": 7}, 3)
    assert ledger.is_current(project, "train", key, 3)
    assert not ledger.is_current(project, "train", "other", 3)
    assert not ledger.begin_part(project, "train", "other", 3)


def test_every_eighth_frame_is_held_out():
    assert sorted(held_out(30, 8)) == [4, 12, 20, 28]
    assert held_out(30, 0) == frozenset()
