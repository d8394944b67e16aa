"""A command in a terminal writes the same folder as a job of the window."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from test_first_changes import two_viewpoints

from nvsim.cli.guard import CommandStopped
from nvsim.cli.main import main
from nvsim.cli.session import project_job
from nvsim.errors import InputError
from nvsim.events import Done, Progress
from nvsim.project.jobs import worker_lock
from nvsim.project.jobs.files import EventFile, JobCommand, order_path, order_proof
from nvsim.project.jobs.joblist import JobList
from nvsim.project.project import Project


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("nvsim.cli.console._verb", "")
    with Project.create_or_open(tmp_path / "house.nvsim") as project:
        project.set_graph(two_viewpoints())
    return project.root


def test_a_command_leaves_its_order_its_events_and_its_end(root: Path) -> None:
    with project_job(root, "train", False) as (_, listen):
        listen(Progress("train", 1, 2))
        (job,) = JobList(root).jobs()
        assert job.status.state == "running" and job.status.pid == os.getpid()
        listen(Done("train", "two submaps", {}))
    (job,) = JobList(root).jobs()
    assert job.ours and (job.order.verb, job.order.folder, job.order.title) == ("train", os.getcwd(), "Train")
    assert (job.status.state, job.status.code, job.status.message) == ("done", 0, "two submaps")
    assert Progress("train", 1, 2) in [event for _, event in EventFile(job.events).read()]


@pytest.mark.parametrize(("error", "state"), [(InputError("no floor"), "failed"), (CommandStopped(), "interrupted")])
def test_a_command_that_runs_again_continues_its_job(root: Path, error: BaseException, state: str) -> None:
    with pytest.raises(type(error)), project_job(root, "train", False):
        raise error
    (job,) = JobList(root).jobs()
    assert job.status.state == state and (state != "failed" or job.status.message == "no floor")
    with project_job(root, "train", False):
        pass
    assert [j.status.state for j in JobList(root).jobs()] == ["done"]
    with project_job(root, "train", False):
        pass
    assert [j.number for j in JobList(root).jobs()] == [1, 2], "a finished job stays"


def test_the_command_line_is_the_order(root: Path) -> None:
    assert main(["submaps", "--project", "house.nvsim", "--count", "2"]) == 2
    (job,) = JobList(root).jobs()
    assert (job.order.verb, job.order.arguments) == ("submaps", ("--project", "house.nvsim", "--count", "2"))
    assert job.status.state == "failed" and "nvsim import" in job.status.message


def test_a_queued_job_waits_for_a_command_in_a_terminal(root: Path) -> None:
    jobs = JobList(root)
    jobs.add("map", ["--project", str(root)], "Map")
    with project_job(root, "train", False):
        assert jobs.claim() is None
    assert jobs.claim() is not None


def test_a_refused_import_leaves_no_files(root: Path) -> None:
    new = root.with_name("new.nvsim")
    with pytest.raises(InputError), project_job(new, "import", False, create=True):
        raise InputError("no capture")
    assert not new.exists()


def test_the_window_continues_a_command_in_its_folder(root: Path) -> None:
    jobs = JobList(root)
    order = JobCommand("export r2r", ("--project", "house.nvsim", "--out", "out"), "Export R2R", folder=os.getcwd())
    job = jobs.begin(order)
    worker_lock.release(job.folder)  # as if it was killed
    (job,) = jobs.jobs()
    assert job.status.state == "interrupted" and job.resumable
    jobs.requeue(job.number)
    subprocess.run([sys.executable, "-m", "nvsim.cli.worker", str(root), "1"], cwd="/", check=True, timeout=60)
    assert jobs.jobs()[0].status.state == "done" and (root.parent / "out" / "scans.txt").is_file()


def test_a_command_that_the_window_does_not_offer_cannot_be_continued(root: Path) -> None:
    jobs = JobList(root)
    job = jobs.begin(JobCommand("run", ("x",), "nvsim run", folder=os.getcwd()))
    worker_lock.release(job.folder)
    assert jobs.jobs()[0].status.state == "interrupted" and not jobs.jobs()[0].resumable
    with pytest.raises(InputError, match="cannot be a job"):
        jobs.requeue(job.number)


def test_a_command_runs_without_a_place_for_the_secret(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/proc/none")
    with project_job(root, "train", False):
        pass
    (job,) = JobList(root).jobs()
    assert job.status.state == "done" and not job.ours


def test_an_order_of_an_earlier_version_stays_ours(root: Path) -> None:
    jobs = JobList(root)
    job = jobs.add("map", ["--project", str(root)], "Map")
    said = {name: value for name, value in asdict(job.order).items() if name != "folder"}
    said["arguments"] = list(said["arguments"])
    order_path(job.folder).write_text(json.dumps({**said, "proof": order_proof(root, "order", [1, said])}))
    assert JobList(root).jobs() == [replace(job, ours=True)]
