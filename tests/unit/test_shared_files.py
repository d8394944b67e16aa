"""Files in folders that several users share: permissions by the umask, and sentences that name what refuses."""

from __future__ import annotations

import errno
import fcntl
import os
import sqlite3
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from nvsim.cli.guard import run_guarded
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.databases import sqlite_error
from nvsim.files.locking import WriterLock
from nvsim.graph.journal_file import JournalFile
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.project.jobs import joblist
from nvsim.project.jobs.joblist import JobList
from nvsim.project.project import Project

GRAPH = NavGraph("s", {"a": Viewpoint("a", (0.0, 0.0, 1.5))}, {})


@pytest.fixture(params=[0o000, 0o002, 0o022, 0o077], ids=oct)
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    former = os.umask(request.param)
    yield request.param
    os.umask(former)


def test_every_file_of_a_project_has_the_permissions_of_the_umask(tmp_path: Path, umask: int) -> None:
    root = tmp_path / "p.nvsim"
    with Project.create_or_open(root) as project:
        project.set_result("graph", {"x": 1})
        edits = JournalFile(root / "edits.db")
        edits.create(GRAPH, "")
        JobList(root).add("map", ["--project", str(root)], "map")
        atomic.write_text(root / "notes.txt", "x")
        files = {path.name: path.stat() for path in root.rglob("*") if path.is_file()}  # SQLite's own beside them too
        edits.close()
    databases = {f"{name}.db{end}" for name in ("project", "edits") for end in ("", "-wal", "-shm")}
    assert {*databases, ".lock", ".writer", "notes.txt"} <= files.keys()
    for name, found in files.items():
        assert stat.S_IMODE(found.st_mode) & 0o666 == 0o666 & ~umask, name


def test_the_sentence_names_the_owner_of_what_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = tmp_path / "edits.db"
    taken.touch()
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != taken)
    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    error = sqlite3.OperationalError("attempt to write a readonly database")
    owner = atomic._user(os.getuid())
    assert f"permission is denied, as {taken} belongs to {owner}; ask {owner}" in str(sqlite_error(taken, error))
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) == taken)
    for path in (taken, tmp_path / "new" / "deeper.txt"):
        sentence = str(atomic.as_input_error(path, PermissionError(errno.EACCES, "Permission denied")))
        assert f"as {tmp_path} belongs to {owner}" in sentence


def test_a_user_without_a_name_is_named_by_number() -> None:
    assert atomic._user(54321) == "user 54321"


def test_an_own_folder_that_is_closed_belongs_to_nobody_else(tmp_path: Path) -> None:
    sentence = str(atomic.as_input_error(tmp_path / "x", PermissionError(errno.EACCES, "Permission denied")))
    assert "belongs" not in sentence and "permission is denied" in sentence


@pytest.mark.parametrize("number", [errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    root = tmp_path / "p.nvsim"
    Project.create_or_open(root).close()
    jobs = JobList(root)
    job = jobs.add("map", ["--project", str(root)], "map")

    def flock(file: object, flags: int) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patched:
        patched.setattr(fcntl, "flock", flock)
        for write in (
            lambda: WriterLock(root / ".writer"),
            lambda: Project.open(root, writable=True),
            lambda: jobs.add("map", ["--project", str(root)], "map"),
            lambda: jobs.claim(job.number),
            lambda: jobs.remove(job.number),
        ):
            with pytest.raises(
                InputError, match="cannot lock files .some network file systems cannot.; choose a folder"
            ):
                write()
        assert [j.number for j in jobs.jobs()] == [job.number]  # looking needs no lock


def test_a_lock_that_fails_while_a_job_is_taken_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = tmp_path / "p.nvsim"
    Project.create_or_open(root).close()
    jobs = JobList(root)
    job = jobs.add("map", ["--project", str(root)], "map")
    calls = []

    def flock(file: object, flags: int) -> None:
        calls.append(flags)
        if flags & fcntl.LOCK_NB:  # that of the worker
            raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", flock)
    with pytest.raises(InputError, match="cannot lock files"):
        jobs.claim(job.number)
    assert calls


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOSPC, "the disk is full"),
        (errno.EDQUOT, "the disk quota is used up"),
        (errno.EROFS, "the file system is read-only; choose another folder"),
    ],
)
def test_a_disk_that_refuses_anywhere_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, number: int, words: str
) -> None:
    from nvsim.cli.commands.graph_edit import GraphLog

    def fail(_: object) -> int:
        raise OSError(number, os.strerror(number), str(tmp_path / "x"))

    monkeypatch.setattr(GraphLog, "run", fail)
    assert run_guarded("graph log", GraphLog, ["x"]) == 2
    assert f"Cannot write {tmp_path / 'x'}: {words}" in capsys.readouterr().err


def test_a_job_that_ended_on_a_full_disk_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = tmp_path / "p.nvsim"
    Project.create_or_open(root).close()
    jobs = JobList(root)
    job = jobs.add("map", ["--project", str(root)], "map")
    jobs._write(job, joblist.JobStatus("running", 999_999, 1.0))
    seen = jobs.job(job.number)
    assert seen is not None and "probably killed" in seen.status.message
    from types import SimpleNamespace

    monkeypatch.setattr(joblist.shutil, "disk_usage", lambda folder: SimpleNamespace(free=4096))
    seen = jobs.job(job.number)
    assert seen is not None and seen.status.state == "interrupted" and "the disk is full" in seen.status.message


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (sqlite3.SQLITE_FULL, "the disk is full"),
        (sqlite3.SQLITE_BUSY, "another program has locked it"),
        (sqlite3.SQLITE_IOERR, "network file system that cannot lock files"),
        (sqlite3.SQLITE_CANTOPEN, "check that the folder is writable"),
    ],
)
def test_errors_of_databases_name_their_cause(tmp_path: Path, code: int, words: str) -> None:
    error = sqlite3.OperationalError("x")
    error.sqlite_errorcode = code
    assert words in str(sqlite_error(tmp_path / "a.db", error))
