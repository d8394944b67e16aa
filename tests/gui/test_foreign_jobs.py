"""A project from another person contains jobs: the window shows them, runs none, and lets the user order one here."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from demo_project import write_project
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from nvsim.errors import InputError
from nvsim.events import Preview
from nvsim.project.jobs.files import event_line
from nvsim.project.jobs.joblist import JobList
from nvsim_app.forms.fields import Settings
from nvsim_app.jobs.queue import JobQueue
from nvsim_app.panels.job_table import ImportedJobDialog
from nvsim_app.panels.jobs import JobPanel
from nvsim_app.session import Session

SECONDS = 60_000


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return write_project(tmp_path / "house.nvsim", count=300, models=1)


def foreign(project: Path, verb: str, *arguments: str, state: str = "queued") -> Path:
    """A job as it comes with a project: ordered, but not here."""
    job = JobList(project).add(verb, arguments, "Theirs")
    data = json.loads((job.folder / "order.json").read_text())
    (job.folder / "order.json").write_text(json.dumps({**data, "proof": "0" * 64}))
    (job.folder / "standing.json").write_text(json.dumps({"state": state}))
    return job.folder


def test_run_everything_runs_nothing_that_came_with_the_project(
    project: Path, tmp_path: Path, qtbot: QtBot, session: Session
) -> None:
    canary = tmp_path / "canary"
    folders = [
        foreign(project, "export r2r", "--project", str(project), "--force", "--out", str(canary)),
        foreign(project, "floors", "--project", str(project), "--discard-corrections", state="interrupted"),
    ]
    jobs = session.window.jobs
    with qtbot.waitSignal(jobs.foundForeign, timeout=SECONDS) as found:
        session.open(project)
    assert [h.state for h in found.args[0]] == ["foreign", "foreign"]
    qtbot.waitUntil(lambda: session.window.actions_table["run_everything"].isEnabled(), timeout=SECONDS)
    session.window.actions_table["run_everything"].trigger()
    own = [h for h in jobs.handles if h.is_own]
    qtbot.waitUntil(lambda: own[0].state in ("done", "failed"), timeout=SECONDS)
    jobs.begin_waiting()
    jobs.resume(jobs.handles[1])
    for handle in own[1:]:
        jobs.cancel(handle)
    qtbot.waitUntil(lambda: not jobs.running, timeout=SECONDS)
    assert [h.state for h in jobs.handles[:2]] == ["foreign", "foreign"]
    assert not canary.exists() and not any((folder / "events.jsonl").exists() for folder in folders)
    assert any("ordered elsewhere" in text for text in session.window.notice_area.texts)
    panel = session.window.panels["jobs"]
    assert isinstance(panel, JobPanel)
    panel.choose(jobs.handles[0])
    buttons = panel.buttons_of[jobs.handles[0]]
    assert buttons.buttons["inspect"].isVisible() and not buttons.buttons["resume"].isVisible()
    assert "ordered elsewhere" in buttons.commands["resume"].toolTip()
    assert panel.model.index(panel.table.currentIndex().row(), 1).data() == "ordered elsewhere"


def test_a_foreign_job_that_writes_outside_the_project_is_shown_but_not_ordered(project: Path, qtbot: QtBot) -> None:
    foreign(project, "export r2r", "--project", str(project), "--out", "/tmp/somewhere else")
    queue = JobQueue()
    queue.set_project(project)
    dialog = ImportedJobDialog(queue, queue.handles[0].job)
    qtbot.addWidget(dialog)
    assert "--out '/tmp/somewhere else'" in dialog.command.toPlainText()
    assert not dialog.order.isEnabled() and "outside of the project" in dialog.problem.text()
    with pytest.raises(InputError, match="outside of the project"):
        queue.order_again(queue.handles[0].job)
    qtbot.mouseClick(dialog.remove, Qt.MouseButton.LeftButton)
    assert queue.handles == []
    queue.stop()


def test_a_foreign_job_runs_after_the_user_orders_it(project: Path, qtbot: QtBot) -> None:
    foreign(project, "submaps", "--project", str(project), "--count", "1")
    queue = JobQueue()
    queue.set_project(project)
    (handle,) = queue.handles
    dialog = ImportedJobDialog(queue, handle.job)
    qtbot.addWidget(dialog)
    assert dialog.order.isEnabled()
    qtbot.mouseClick(dialog.order, Qt.MouseButton.LeftButton)
    assert handle.is_own
    qtbot.waitUntil(lambda: handle.state in ("done", "failed"), timeout=SECONDS)
    queue.stop()


def test_a_preview_of_a_job_is_read_only_from_the_pictures_of_the_project(project: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.jpg")
    folder = foreign(project, "train", state="failed")
    (folder / "events.jsonl").write_text(event_line(Preview("train", str(tmp_path / "pipe.jpg")), 1.0))
    queue = JobQueue()
    queue.set_project(project)
    (handle,) = queue.handles
    handle.read_events()
    (project / "pictures").mkdir(exist_ok=True)
    (path,) = handle.history.images
    assert handle.picture(path) == project / "pictures" / "pipe.jpg"
    queue.stop()


def test_paths_in_the_settings_of_a_foreign_project_are_ignored(project: Path, tmp_path: Path) -> None:
    (project / "settings.json").write_text(
        json.dumps({"evaluate graph": {"picture": str(tmp_path / "theirs.png"), "robot_radius": 0.5}})
    )
    assert Settings(project).changed("evaluate graph") == {"robot_radius": 0.5}
    Settings(project).keep("evaluate graph", "", {"picture": str(tmp_path / "mine.png"), "robot_radius": 0.4})
    assert Settings(project).changed("evaluate graph") == {
        "picture": str(tmp_path / "mine.png"),
        "robot_radius": 0.4,
    }
    text = (project / "settings.json").read_text().replace("mine.png", "other.png")
    (project / "settings.json").write_text(text)
    assert Settings(project).changed("evaluate graph") == {"robot_radius": 0.4}
    inside = str(project / "pictures" / "map.png")
    (project / "settings.json").write_text(json.dumps({"evaluate graph": {"picture": inside}}))
    assert Settings(project).changed("evaluate graph") == {"picture": inside}
    (project / "settings.json").unlink()
    os.mkfifo(project / "settings.json")
    assert Settings(project).changed("evaluate graph") == {}


def test_a_project_does_not_choose_the_machines_that_a_job_talks_to(project: Path, qtbot: QtBot) -> None:
    foreign(project, "train", "--project", str(project), "--executor", "ray", "--address", "theirs:6379")
    queue = JobQueue()
    queue.set_project(project)
    with pytest.raises(InputError, match="would run on a cluster at theirs:6379"):
        queue.order_again(queue.handles[0].job)
    queue.stop()
    cluster = {"cluster.executor": "ray", "cluster.address": "theirs:6379"}
    (project / "settings.json").write_text(json.dumps({"train": {**cluster, "at_once": 2}}))
    assert Settings(project).changed("train") == {"at_once": 2}
    Settings(project).keep("train", "nvsim", cluster)
    assert Settings(project).changed("train") == cluster
    text = (project / "settings.json").read_text()
    (project / "settings.json").write_text(text.replace("theirs", "others"))
    assert Settings(project).changed("train") == {}
    sending = {"asked.endpoint": "http://theirs/v1", "asked.key_variable": "SECRET", "asking.yes": True}
    (project / "settings.json").write_text(json.dumps({"export tasks": sending}))
    assert Settings(project).changed("export tasks") == {}
