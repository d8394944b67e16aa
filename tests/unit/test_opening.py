"""Links in projects and graphs from other people: NVSim never writes to their targets."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from nvsim.cli.guard import run_guarded
from nvsim.errors import InputError
from nvsim.files.atomic import write_text
from nvsim.files.opening import NotPlainFile, open_own_file, plain_file, read_bytes
from nvsim.graph.journal import Journal
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.project.jobs.joblist import JobList
from nvsim.project.layout import Layout
from nvsim.project.project import Project

LETTER = "a letter of the user's\n"


@pytest.fixture
def letter(tmp_path: Path) -> Path:
    path = tmp_path / "letter.txt"
    path.write_text(LETTER)
    return path


@pytest.fixture
def project(tmp_path: Path) -> Path:
    root = tmp_path / "given.nvsim"
    with Project.create_or_open(root) as opened:
        opened.set_graph(NavGraph("given", {"a": Viewpoint("a", (0.0, 0.0, 1.5))}, {}))
    return root


def put_link(link: Path, to: Path) -> None:
    link.unlink(missing_ok=True)
    link.symlink_to(to)


def test_a_lock_that_is_a_link_is_refused_and_its_target_stays(project: Path, letter: Path) -> None:
    put_link(Layout(project).lock, letter)
    with pytest.raises(InputError, match="symbolic link"):
        Project.open(project, writable=True)
    assert letter.read_text() == LETTER


def test_a_history_whose_lock_is_a_link_can_only_be_looked_at(project: Path, letter: Path) -> None:
    put_link(project / "edits.db.lock", letter)
    with Journal.open(Layout(project).edits) as journal:
        assert journal.refusal is not None and "symbolic link" in journal.refusal and not journal.busy
    assert letter.read_text() == LETTER


@pytest.mark.parametrize("dangling", [False, True])
def test_a_link_to_what_is_not_there_makes_nothing(tmp_path: Path, dangling: bool) -> None:
    target = tmp_path / "elsewhere" / "new.txt" if dangling else tmp_path / "new.txt"
    put_link(tmp_path / "lock", target)
    with pytest.raises(NotPlainFile):
        plain_file(tmp_path / "lock", os.O_RDWR | os.O_CREAT)
    assert not target.exists()


@pytest.mark.timeout(20)
@pytest.mark.parametrize("flags", [os.O_RDWR, os.O_WRONLY, os.O_RDONLY])
def test_a_pipe_in_place_of_a_file_is_refused_at_once(tmp_path: Path, flags: int) -> None:
    os.mkfifo(tmp_path / "lock")
    with pytest.raises(NotPlainFile, match="not a plain file"):
        plain_file(tmp_path / "lock", flags | os.O_CREAT)


@pytest.mark.timeout(20)
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_log_takes_the_place_of_a_link_or_a_pipe(tmp_path: Path, letter: Path, kind: str) -> None:
    log = tmp_path / "log"
    if kind == "link":
        put_link(log, letter)
    else:
        os.mkfifo(log)
    descriptor = open_own_file(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.write(descriptor, b"line\n")
    os.close(descriptor)
    assert log.read_text() == "line\n" and not log.is_symlink() and letter.read_text() == LETTER


def test_a_job_writes_its_logs_into_files_of_its_own(project: Path, letter: Path, tmp_path: Path) -> None:
    job = JobList(project).add("export splats", ["--project", str(project), "--out", "splats"], "Export")
    for path in (job.events, job.output, job.messages):
        put_link(path, letter)
    subprocess.run([sys.executable, "-P", "-m", "nvsim.cli.worker", str(project)], check=False, timeout=120)
    assert letter.read_text() == LETTER
    assert "Started." in job.events.read_text() and "has no capture yet" in job.messages.read_text()


@pytest.mark.parametrize("suffix", ["", "-wal", "-shm", "-journal"])
@pytest.mark.parametrize("writable", [False, True])
def test_a_database_that_is_a_link_is_refused(project: Path, letter: Path, suffix: str, writable: bool) -> None:
    database = Layout(project).database
    if not suffix:
        shutil.copy(database, letter)
    before = letter.read_bytes()
    put_link(database.with_name(database.name + suffix), letter)
    with pytest.raises(InputError, match="symbolic link"):
        Project.open(project, writable=writable)
    assert letter.read_bytes() == before


def test_a_history_that_is_a_link_is_refused(project: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.db"
    graph = NavGraph("given", {"a": Viewpoint("a", (0.0, 0.0, 1.5))}, {})
    with Journal.open(other) as journal:
        journal.history(graph).perform("Add", NavGraph("given", {"b": Viewpoint("b", (0.0, 1.0, 1.5))}, {}))
    before = other.read_bytes()
    put_link(Layout(project).edits, other)
    with pytest.raises(InputError, match="symbolic link"):
        Journal.open(Layout(project).edits)
    assert other.read_bytes() == before


@pytest.mark.parametrize("folder", ["masks", "corrections", "logs/jobs", "models/submap_000"])
def test_nothing_is_written_through_a_folder_that_leads_out_of_the_project(
    project: Path, tmp_path: Path, folder: str
) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (project / folder).parent.mkdir(parents=True, exist_ok=True)
    (project / folder).symlink_to(outside)
    with pytest.raises(InputError, match="leads out of the project"):
        write_text(project / folder / "deeper" / "file.txt", "text")
    if folder != "logs/jobs":
        with pytest.raises(InputError, match="leads out of the project"):
            Project.open(project, writable=True)
    assert not any(outside.iterdir())
    Project.open(project).close()  # it can be looked at


def test_links_inside_a_project_and_to_a_project_are_followed(project: Path, tmp_path: Path) -> None:
    (project / "kept").mkdir()
    (project / "models").symlink_to(project / "kept")
    way = tmp_path / "way.nvsim"
    way.symlink_to(project)
    Project.open(way, writable=True).close()
    write_text(way / "models" / "file.txt", "text")
    assert (project / "kept" / "file.txt").read_text() == "text"


def test_a_traceback_goes_to_a_file_whose_name_nobody_could_take_before(
    tmp_path: Path, letter: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(shared))
    for second in range(30):
        name = time.strftime("%Y%m%d-%H%M%S", time.localtime(time.time() + second))
        put_link(shared / f"nvsim-check-{name}.log", letter)

    class Fails:
        def run(self) -> int:
            raise RuntimeError("a mistake of ours")

    monkeypatch.setattr("nvsim.cli.arguments.parse", lambda command, argv, verb: command())
    monkeypatch.setattr("signal.signal", lambda number, handler: None)
    assert run_guarded("check", Fails, []) == 1
    assert letter.read_text() == LETTER
    (log,) = (path for path in shared.iterdir() if not path.is_symlink())
    assert "a mistake of ours" in log.read_text() and str(log) in capsys.readouterr().err
    assert log.stat().st_mode & 0o077 == 0


def test_a_mask_of_another_walk_is_not_carried_through_a_link(project: Path, letter: Path) -> None:
    from nvsim.project.corrections import save_correction  # the same writer carries and saves

    class Named:
        name = "images/1.jpg"

    target = Layout(project).correction(Named.name)
    target.parent.mkdir()
    put_link(target, letter)
    save_correction(Layout(project), Named(), np.ones((4, 4), np.bool_))  # type: ignore[arg-type]
    assert letter.read_text() == LETTER and not target.is_symlink()


def test_a_pipe_is_refused_before_it_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    (tmp_path / "link").symlink_to(pipe)
    monkeypatch.setattr(os, "open", lambda *_: pytest.fail("to open it may have an effect"))
    for path in (pipe, tmp_path / "link"):
        with pytest.raises(InputError, match="a pipe, a socket or a device"):
            read_bytes(path)
