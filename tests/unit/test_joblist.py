"""Jobs on disk: their state after they end, are asked to stop, or are killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nvsim.errors import InputError
from nvsim.events import Log, Metric, Progress
from nvsim.project.jobs.files import EventFile, event_line, event_of_line
from nvsim.project.jobs.joblist import KEPT, Job, JobList


@pytest.fixture
def jobs(tmp_path: Path) -> JobList:
    return JobList(tmp_path / "house.nvsim")


def other_process(jobs: JobList, number: int | None = None) -> subprocess.Popen[str]:
    """Claims a job and sleeps, in a process group of its own."""
    program = (
        "import sys, time\nfrom nvsim.project.jobs.joblist import JobList\n"
        f"job = JobList(sys.argv[1]).claim({number})\nprint('none' if job is None else job.number, flush=True)\n"
        "time.sleep(60)"
    )
    command = [sys.executable, "-c", program, str(jobs.root)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stdout is not None
    assert process.stdout.readline().strip() != ""
    return process


def state(jobs: JobList, number: int) -> str:
    found = jobs.job(number)
    assert found is not None
    return found.status.state


def wait_for(jobs: JobList, number: int, wanted: str) -> Job:
    for _ in range(200):
        found = jobs.job(number)
        if found is not None and found.status.state == wanted:
            return found
        time.sleep(0.02)
    raise AssertionError(f"job {number} is {state(jobs, number)}, not {wanted}")


def test_jobs_are_done_in_the_order_they_were_ordered(jobs: JobList) -> None:
    for verb in ("train", "map"):
        jobs.add(verb, ["--project", str(jobs.root)], verb.title())
    first = jobs.claim()
    assert first is not None and first.order.verb == "train"
    assert jobs.claim() is None  # one heavy job at a time
    jobs.finish(first, 0, "done")
    second = jobs.claim()
    assert second is not None and second.order.verb == "map" and second.order.arguments == ("--project", str(jobs.root))


def test_a_light_job_does_not_wait_for_a_heavy_one(jobs: JobList) -> None:
    jobs.add("train", [], "Train")
    light = jobs.add("export r2r", [], "Export", heavy=False)
    assert jobs.claim() is not None and jobs.claim(light.number) is not None


def test_only_one_process_gets_a_job(jobs: JobList) -> None:
    job = jobs.add("train", [], "Train")
    process = other_process(jobs)
    try:
        assert jobs.claim() is None and jobs.claim(job.number) is None
        assert state(jobs, job.number) == "running"
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize(("wish", "becomes"), [("pause", "paused"), ("cancel", "cancelled")])
def test_a_job_that_was_asked_to_stop_has_done_what_was_asked_even_when_it_was_killed(
    jobs: JobList, wish: str, becomes: str
) -> None:
    job = jobs.add("train", [], "Train")
    process = other_process(jobs)
    try:
        jobs.ask(job.number, wish)  # type: ignore[arg-type]
        process.wait(10)  # this one does not handle SIGTERM
        assert wait_for(jobs, job.number, becomes)
    finally:
        process.kill()
        process.wait()


def test_a_killed_job_is_interrupted_and_can_be_run_again(jobs: JobList) -> None:
    job = jobs.add("train", [], "Train")
    process = other_process(jobs)
    os.kill(process.pid, signal.SIGKILL)
    found = wait_for(jobs, job.number, "interrupted")  # although nobody has waited for it: a zombie is dead
    assert "ended without an error" in found.status.message
    process.wait()
    jobs.requeue(job.number)
    assert state(jobs, job.number) == "queued"
    assert jobs.claim() is not None


def test_a_job_that_waits_obeys_at_once(jobs: JobList) -> None:
    job = jobs.add("train", [], "Train")
    jobs.ask(job.number, "cancel")
    assert state(jobs, job.number) == "cancelled" and jobs.claim() is None


@pytest.mark.parametrize(("code", "becomes"), [(0, "done"), (1, "failed"), (2, "failed"), (130, "interrupted")])
def test_the_exit_code_says_how_it_ended(jobs: JobList, code: int, becomes: str) -> None:
    job = jobs.add("train", [], "Train")
    claimed = jobs.claim()
    assert claimed is not None
    jobs.finish(claimed, code, "because")
    assert state(jobs, job.number) == becomes


def test_a_removed_job_is_named(jobs: JobList) -> None:
    job = jobs.add("train", [], "Train")
    jobs.remove(job.number)
    assert jobs.jobs() == []
    with pytest.raises(InputError, match="no job 1"):
        jobs.requeue(job.number)


def test_old_jobs_are_cleared_away_but_none_that_waits(jobs: JobList) -> None:
    first = jobs.add("train", [], "Train")
    for _ in range(KEPT + 5):
        job = jobs.add("map", [], "Map")
        jobs.ask(job.number, "cancel")
    assert len(jobs.jobs()) <= KEPT + 2
    assert state(jobs, first.number) == "queued"


def test_a_damaged_folder_does_not_hide_the_others(jobs: JobList) -> None:
    jobs.add("train", [], "Train")
    damaged = jobs.add("map", [], "Map")
    (damaged.folder / "order.json").write_text("{")
    assert [j.order.verb for j in jobs.jobs()] == ["train"]


def test_events_keep_their_time_through_the_file() -> None:
    event = Metric("train", "psnr", 24.5, 100, 2)
    assert event_of_line(event_line(event, 1753.25)) == (1753.25, event)
    with pytest.raises(ValueError, match="not an event"):
        event_of_line('{"event": "log", "text": "no time"}')


def test_a_growing_file_is_read_once_and_a_line_cut_off_by_a_kill_is_skipped(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    file = EventFile(path)
    assert file.read() == [] and not file.has_unread_events
    whole = event_line(Progress("train", 1, 2), 1.0)
    path.write_text(whole[:-10])
    assert file.read() == []
    with open(path, "a") as out:
        out.write(whole[-10:] + '{"at": 2.0, "eve\n' + event_line(Log("x"), 3.0))
    assert file.has_unread_events
    assert [type(e).__name__ for _, e in file.read()] == ["Progress", "Log"]
    assert file.read() == []
