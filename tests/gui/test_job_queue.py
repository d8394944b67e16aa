"""The queue runs the real command line in processes of its own, which outlive it."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import demo_project
import psutil
import pytest
from pytestqt.qtbot import QtBot

from nvsim.events import Event, Failed, Log, Metric, Progress, Worker
from nvsim.project import ledger
from nvsim.project.jobs.files import STATUS, encode_status, event_line
from nvsim.project.jobs.joblist import JobList, JobStatus, State, Wish
from nvsim.project.jobs.worker_lock import is_job_running
from nvsim.project.project import Project
from nvsim_app.jobs.history import MOST_POINTS, MOST_WORKERS, JobReport, MetricSeries
from nvsim_app.jobs.queue import JobHandle, JobQueue
from nvsim_app.panels.jobs import JobPanel

SECONDS = 60_000


@pytest.fixture
def project(tmp_path: Path) -> Path:
    path = demo_project.write_project(tmp_path / "demo.nvsim", count=500, models=1)
    with Project.open(path, writable=True) as made:
        ledger.begin_part(made, "import", "a key")
        ledger.finish(made, "import", 0.0, {})
    return path


@pytest.fixture
def queue(qtbot: QtBot, project: Path) -> JobQueue:
    made = JobQueue()
    made.set_project(project)
    return made


def until(qtbot: QtBot, handle: JobHandle, *states: str) -> None:
    qtbot.waitUntil(lambda: handle.state in states, timeout=SECONDS)


def test_a_job_runs_and_reports_its_end(qtbot: QtBot, queue: JobQueue, project: Path) -> None:
    handle = queue.start("submaps", ["--project", str(project), "--count", "2"], project, "Cut into submaps")
    with qtbot.waitSignal(queue.ended, timeout=SECONDS):
        until(qtbot, handle, "done", "failed")
    assert handle.state == "done", handle.message
    assert "2 submaps" in handle.message
    assert handle.history.lines[0].text == "Started."


def test_an_invalid_value_is_reported_in_one_sentence(qtbot: QtBot, queue: JobQueue, project: Path) -> None:
    wrong = queue.start("submaps", ["--project", str(project), "--count", "0"], project, "Cut into submaps")
    until(qtbot, wrong, "failed")
    assert "give at least 1" in wrong.message and wrong.job.status.code == 2


def test_a_stored_job_with_a_removed_option_names_itself_and_the_option_and_later_jobs_run(
    qtbot: QtBot, queue: JobQueue, project: Path
) -> None:
    """An earlier version stored the job; its option `--color` does not exist any more."""
    jobs = JobList(project)
    jobs.add("submaps", ["--project", str(project), "--colour", "red"], "Old job")
    jobs.add("submaps", ["--project", str(project), "--count", "2"], "Next job")
    qtbot.waitUntil(lambda: len(queue.handles) == 2, timeout=SECONDS)
    old, later = queue.handles
    queue.begin_waiting()
    until(qtbot, old, "failed")
    assert old.message == (
        "The job “Old job” cannot run because its option --colour is not valid in this version of NVSim; remove the "
        "job and add it again from the Jobs menu."
    )
    assert "There is no option --colour; " in old.job.messages.read_text() and old.job.status.code == 2
    assert queue.why_not_resume(later) == ""
    queue.resume(later)
    until(qtbot, later, "done", "failed")
    assert later.state == "done", later.message
    queue.remove(old)
    assert queue.handles == [later]


def test_heavy_jobs_wait_for_each_other_and_the_worker_hands_on_by_itself(
    qtbot: QtBot, queue: JobQueue, project: Path
) -> None:
    first = queue.start("submaps", ["--project", str(project), "--count", "3"], project, "one")
    second = queue.start("submaps", ["--project", str(project), "--count", "2"], project, "two")
    most = 0
    with qtbot.waitSignal(queue.ended, timeout=SECONDS):
        pass
    queue.stop()  # nobody looks any more, and still the second one comes
    jobs = JobList(project)

    def both_done() -> bool:
        nonlocal most
        states = [j.status.state for j in jobs.jobs()]
        most = max(most, states.count("running"))
        return states == ["done", "done"]

    qtbot.waitUntil(both_done, timeout=SECONDS)
    assert most <= 1 and first.number < second.number


def test_a_job_outlives_the_process_that_ordered_it(qtbot: QtBot, project: Path) -> None:
    program = (
        "import sys\nfrom nvsim_app.jobs.queue import JobQueue\nfrom PySide6.QtCore import QCoreApplication\n"
        "from pathlib import Path\napp = QCoreApplication([])\nqueue = JobQueue()\nproject = Path(sys.argv[1])\n"
        "queue.set_project(project)\n"
        "queue.start('submaps', ['--project', str(project), '--count', '2'], project, 'Cut')\n"
        "import os, signal\nos.kill(os.getpid(), signal.SIGKILL)\n"
    )
    ended = subprocess.run([sys.executable, "-c", program, str(project)], check=False, capture_output=True)
    assert ended.returncode == -9, ended.stderr
    queue = JobQueue()
    queue.set_project(project)
    assert queue.handles[0].state in ("queued", "running")
    until(qtbot, queue.handles[0], "done")


def test_a_cancelled_job_leaves_no_process(qtbot: QtBot, queue: JobQueue, project: Path) -> None:
    handle = queue.start("floors", ["--project", str(project)], project, "Find the floor")
    until(qtbot, handle, "running")
    pid = handle.job.status.pid
    queue.cancel(handle)
    until(qtbot, handle, "cancelled", "failed")
    qtbot.waitUntil(lambda: not is_job_running(handle.job.folder), timeout=SECONDS)
    qtbot.waitUntil(lambda: not psutil.pid_exists(pid) or psutil.Process(pid).status() == "zombie", timeout=SECONDS)


@pytest.mark.parametrize("wish", ["pause", "cancel"])
def test_a_job_that_was_stopped_shows_how_far_it_came_and_where(qtbot: QtBot, project: Path, wish: Wish) -> None:
    jobs = JobList(project)
    job = jobs.add("train", ["--project", str(project)], "Train")
    steps = Progress("train", 300, 1200, "submap 0, step 300")
    job.events.write_text(event_line(Log("Started."), 0.0) + event_line(steps, 1.0))
    jobs.ask(job.number, wish)
    panel = JobPanel(queue := JobQueue())
    qtbot.addWidget(panel)
    queue.set_project(project)
    qtbot.waitUntil(lambda: panel.model.rows[0].share == 0.25, timeout=SECONDS)
    row = panel.model.rows[0]
    assert row.note == "Stopped at 25 % of train: submap 0, step 300"
    commands = panel.buttons_of[queue.handles[0]].commands.values()
    usable = {command.text() for command in commands if command.isEnabled()}
    stopped = {"Continue", "Enlarge…", "Settings…", "Remove", "Copy command"}
    assert usable == stopped | ({"Cancel"} if wish == "pause" else set())
    queue.set_project(None)


@pytest.mark.parametrize("state", ["queued", "failed", "interrupted"])
def test_a_job_that_was_never_selected_shows_its_progress(qtbot: QtBot, project: Path, state: State) -> None:
    jobs = JobList(project)
    job = jobs.add("train", ["--project", str(project)], "Train")
    job.events.write_text(event_line(Log("Started."), 0.0) + event_line(Progress("train", 3, 4, "submap 0"), 1.0))
    (job.folder / STATUS).write_text(encode_status(JobStatus(state, message="The disk is full.")))
    panel = JobPanel(queue := JobQueue())
    qtbot.addWidget(panel)
    other = jobs.add("map", ["--project", str(project)], "Map")  # the newest, whose details are shown
    queue.set_project(project)
    qtbot.waitUntil(lambda: {r.handle.number: r.share for r in panel.model.rows}[job.number] == 0.75, timeout=5000)
    assert panel.handle is not None and panel.handle.number == other.number
    painted = {row.handle.number: row for row in panel.model.rows}[job.number]
    assert painted.note == ("" if state == "queued" else "The disk is full.")
    queue.set_project(None)


def test_what_waits_for_a_person_is_found_when_the_project_opens(qtbot: QtBot, project: Path) -> None:
    job = JobList(project).add("submaps", ["--project", str(project), "--count", "2"], "Cut")
    queue = JobQueue()
    with qtbot.waitSignal(queue.found) as found:
        queue.set_project(project)
    assert [h.number for h in found.args[0]] == [job.number]
    queue.begin_waiting()
    until(qtbot, queue.handles[0], "done")


def test_rate_and_time_left_come_from_the_last_half_minute() -> None:
    history = JobReport()
    history.receive(0.0, Log("Started."))
    for second in range(100):
        history.receive(second, Progress("train", (5 if second < 50 else 10) * second, 2000))
    assert history.rate == pytest.approx(10)
    assert history.seconds_left == pytest.approx((2000 - 990) / 10)
    history.receive(100.0, Progress("map", 0, 10))
    assert history.rate is None and history.share == 0


def test_a_series_goes_back_with_the_checkpoint_and_never_grows_without_end() -> None:
    series = MetricSeries()
    for step in range(100):
        series.add(step, step)
    series.add(50, -1.0)
    assert series.steps == list(range(50)) + [50] and series.values[-1] == -1.0
    for step in range(51, 20 * MOST_POINTS):
        series.add(step, step)
    assert len(series.steps) <= MOST_POINTS and series.steps == sorted(set(series.steps))


def test_metrics_of_submaps_stay_apart_and_a_failure_is_kept() -> None:
    history = JobReport()
    history.receive(0.0, Metric("train", "psnr", 20.0, 10, 0))
    history.receive(0.0, Metric("train", "psnr", 22.0, 10, 1))
    history.receive(1.0, Failed("train", "the disk is full", 2))
    assert [s.values for s in history.series["psnr"].values()] == [[20.0], [22.0]]
    assert history.failure == "the disk is full"


def test_the_workers_of_a_job_on_a_cluster_are_shown_with_their_pieces(qtbot: QtBot, project: Path) -> None:
    jobs = JobList(project)
    at_home = jobs.add("floors", ["--project", str(project)], "Find the floor")
    afar = jobs.add("train", ["--project", str(project), "--executor", "ray"], "Train")
    told: list[Event] = [Log("Started.")]
    told += [Worker("train", f"node{i}, process {i}", i, f"submap {i}", "works") for i in range(3)]
    told += [
        Worker("train", "node1, process 1", 1, "submap 1", "lost"),
        Worker("train", "node2, process 2", 2, "submap 2", "ended"),
    ]
    afar.events.write_text("".join(event_line(event, 1000.0) for event in told))
    queue = JobQueue()
    panel = JobPanel(queue)
    qtbot.addWidget(panel)
    panel.resize(900, 240)
    panel.show()
    queue.set_project(project)
    handle = queue.handle(afar.number)
    assert handle is not None
    panel.choose(handle)
    handle.read_events()
    handle.job = replace(handle.job, status=replace(handle.job.status, state="running"))
    panel._refresh_shown()
    tab = panel.tabs.indexOf(panel.workers)
    assert panel.tabs.isTabVisible(tab)
    assert [row[:3] for row in panel.workers.model.rows] == [
        ("node0, process 0", "submap 0", "works"),
        ("node1, process 1", "submap 1", "lost"),
        ("node2, process 2", "–", "idle"),
    ]
    other = queue.handle(at_home.number)
    assert other is not None
    panel.choose(other)
    assert not panel.tabs.isTabVisible(tab)


def test_workers_that_were_told_of_longest_ago_are_forgotten() -> None:
    report = JobReport()
    for i in range(MOST_WORKERS + 5):
        report.receive(float(i), Worker("train", f"process {i}", 0, "submap 0", "works"))
    assert len(report.workers) == MOST_WORKERS
    assert "process 4" not in report.workers and "process 5" in report.workers
    report.receive(1.0, Log("Continued."))
    assert not report.workers
