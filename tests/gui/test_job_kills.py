"""kill -9 of the worker, of the window, and of both at bad moments: nothing that was done is lost, nothing is left."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
import tiny_capture
from demo_project import write_project
from PySide6.QtCore import QSettings, Qt
from PySide6.QtWidgets import QToolButton
from pytestqt.qtbot import QtBot

from nvsim.project.jobs.files import EventFile
from nvsim.project.jobs.joblist import Job, JobList
from nvsim.project.jobs.worker_lock import is_job_running
from nvsim_app.panels.jobs import JobPanel
from nvsim_app.processes.child import RESTARTS
from nvsim_app.session import Session

CHILD = Path(__file__).with_name("window_child.py")
SECONDS = 240.0
PATIENCE = int(1000 * SECONDS)  # milliseconds until an expected event counts as missing, also on a busy machine
pytestmark = pytest.mark.timeout(1800)
STEPS = 500


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project that is ready to be trained."""
    from nvsim.cli.main import main

    folder = tmp_path_factory.mktemp("kills")
    capture, project = tiny_capture.write_capture(folder), folder / "rooms.nvsim"
    for verb in (["import", str(capture)], ["submaps", "--count", "1"], ["floors"]):
        assert main([*verb, "--project", str(project)]) == 0
    long = {**tiny_capture.SETTINGS["train"], "config.steps": STEPS, "config.checkpoint_seconds": 0.1}
    (project / "settings.json").write_text(json.dumps({"train": long}))
    return project


@pytest.fixture
def project(imported: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(imported, tmp_path / "rooms.nvsim"))


@pytest.fixture
def start_window(project: Path) -> Iterator[Callable[[str], subprocess.Popen[str]]]:
    started: list[subprocess.Popen[str]] = []

    def start(verb: str) -> subprocess.Popen[str]:
        environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
        child = subprocess.Popen(
            [sys.executable, str(CHILD), str(project), verb], env=environment, stdout=subprocess.PIPE, text=True
        )
        started.append(child)
        assert child.stdout is not None and child.stdout.readline().strip() == "ready"
        return child

    yield start
    for child in started:
        child.kill()
        child.wait()
    for job in JobList(project).jobs():
        JobList(project).kill(job.number)


def until(what: Callable[[], object]) -> None:
    end = time.monotonic() + SECONDS
    while not what():
        assert time.monotonic() < end, "it never came to that"
        time.sleep(0.02)


def job_of(project: Path) -> Job:
    return JobList(project).jobs()[-1]


def steps_of(job: Job) -> list[int]:
    """Steps of the progress that the job told."""
    file, steps = EventFile(job.events), []
    while file.has_unread_events:
        steps += [int(getattr(e, "done", -1)) for _, e in file.read() if type(e).__name__ == "Progress"]
    return steps


def is_training(project: Path) -> bool:
    jobs = JobList(project).jobs()
    return bool(jobs) and jobs[-1].status.state == "running" and max(steps_of(jobs[-1]), default=0) > 0


def test_a_training_outlives_the_window_that_is_killed(project: Path, start_window) -> None:
    window = start_window("train")
    until(lambda: is_training(project))
    children = psutil.Process(window.pid).children(recursive=True)
    job = job_of(project)
    mine = [c for c in children if c.pid != job.status.pid]
    os.kill(window.pid, signal.SIGKILL)
    window.wait()
    assert is_job_running(job.folder)
    until(lambda: job_of(project).status.state != "running")
    assert job_of(project).status.state == "done"
    assert (project / "models" / "submap_000" / "model.json").is_file()
    until(lambda: not any(c.is_running() and c.status() != psutil.STATUS_ZOMBIE for c in mine))  # who drew is gone too


def test_a_killed_worker_is_offered_again_and_goes_on_from_its_checkpoint(
    project: Path, qtbot: QtBot, session: Session
) -> None:
    from nvsim_app.wiring.jobs import JobsPart

    session.open(project)
    part = session.window.part(JobsPart)
    handle = part.run_stage("train")
    assert handle is not None
    checkpoint = project / "checkpoints" / "submap_000.ckpt"
    qtbot.waitUntil(lambda: is_training(project) and checkpoint.is_file(), timeout=PATIENCE)
    os.killpg(handle.job.status.pid, signal.SIGKILL)
    panel = session.window.panels["jobs"]
    assert isinstance(panel, JobPanel)
    qtbot.waitUntil(panel.offer.isVisible, timeout=PATIENCE)
    assert handle.state == "interrupted" and "was interrupted" in panel.offer.words.text()
    assert any("was interrupted" in text for text in session.window.notice_area.texts)
    qtbot.mouseClick(panel.offer.go_on, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: handle.state == "done", timeout=PATIENCE)
    assert any("continues from step" in line.text for line in handle.history.lines)
    assert not panel.offer.isVisible()


def test_when_worker_and_window_die_together_the_next_window_offers_the_job(
    project: Path, start_window, qtbot: QtBot, session: Session
) -> None:
    window = start_window("train")
    until(lambda: is_training(project))
    os.killpg(job_of(project).status.pid, signal.SIGKILL)
    os.kill(window.pid, signal.SIGKILL)
    window.wait()
    until(lambda: job_of(project).status.state == "interrupted")  # the system ends all processes of a group one by one
    with qtbot.waitSignal(session.window.jobs.found, timeout=PATIENCE) as found:
        session.open(project)
    assert [h.state for h in found.args[0]] == ["interrupted"]
    panel = session.window.panels["jobs"]
    assert isinstance(panel, JobPanel)
    qtbot.waitUntil(panel.offer.isVisible, timeout=PATIENCE)
    qtbot.mouseClick(panel.offer.go_on, Qt.MouseButton.LeftButton)
    handle = session.window.jobs.handles[-1]
    qtbot.waitUntil(lambda: handle.state in ("running", "done"), timeout=PATIENCE)
    session.window.jobs.cancel(handle)
    qtbot.waitUntil(lambda: handle.state in ("cancelled", "done"), timeout=PATIENCE)


def test_a_paused_training_frees_the_project_and_survives_the_window(
    project: Path, qtbot: QtBot, settings: QSettings
) -> None:
    from nvsim.project.project import Project
    from nvsim_app.wiring.jobs import JobsPart

    session = Session(settings)
    qtbot.addWidget(session.window)
    session.window.show()
    session.open(project)
    part = session.window.part(JobsPart)
    handle = part.run_stage("train")
    assert handle is not None
    panel = session.window.panels["jobs"]
    assert isinstance(panel, JobPanel)
    dock = session.window.docks["jobs"]
    dock.show()
    dock.raise_()

    def pause() -> QToolButton:
        return panel.buttons_of[handle].buttons["pause"]  # rows get new buttons when the list changes

    qtbot.waitUntil(lambda: is_training(project) and pause().isVisible(), timeout=PATIENCE)
    qtbot.mouseClick(pause(), Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: handle.state == "paused", timeout=PATIENCE)
    Project.open(project, writable=True).close()  # a person may edit the graph meanwhile
    session.close()
    again = Session(settings)
    qtbot.addWidget(again.window)
    again.window.show()
    again.open(project)
    waiting = again.window.jobs.handles[-1]
    assert waiting.state == "paused"
    again.window.jobs.resume(waiting)
    qtbot.waitUntil(lambda: waiting.state == "done", timeout=PATIENCE)
    again.close()


def test_a_renderer_that_was_given_up_is_started_again_by_refresh(
    tmp_path: Path, qtbot: QtBot, session: Session
) -> None:
    session.open(write_project(tmp_path / "rooms.nvsim", 300, 1))
    link = session.window.scene.link
    for _ in range(RESTARTS + 1):
        # A process that has just ended has no number, although its end is not handled yet.
        qtbot.waitUntil(lambda: link.ready and link.process_id is not None, timeout=PATIENCE)
        pid = link.process_id
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        qtbot.waitUntil(lambda pid=pid: link.process_id != pid, timeout=PATIENCE)
    qtbot.waitUntil(lambda: link.given_up, timeout=PATIENCE)
    assert "File > Refresh" in session.window.scene.feed.note
    session.window.actions_table["refresh"].trigger()
    qtbot.waitUntil(lambda: link.ready and session.window.scene.picture is not None, timeout=PATIENCE)
    assert session.window.scene.feed.note == ""
