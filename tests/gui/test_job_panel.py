"""The panel of jobs: a pipeline from top to bottom, with buttons in each row that act on the job of that row."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

import nvsim_app.jobs.queue
from nvsim.events import Log, Progress
from nvsim.project.jobs import worker_lock
from nvsim.project.jobs.files import STATUS, WISH, JobStatus, encode_status, event_line
from nvsim.project.jobs.joblist import JobList
from nvsim_app.jobs.queue import JobHandle, JobQueue
from nvsim_app.panels.jobs import JobPanel

TITLES = ("Train", "Build the map", "Evaluate the graph")


@dataclass
class Pipeline:
    """A queue whose jobs change only as the test says. `started` are the numbers of the jobs that it starts."""

    queue: JobQueue
    panel: JobPanel
    started: list[int | None] = field(default_factory=list)

    def set(self, number: int, state: str) -> None:
        """Changes the state of a job as its worker does."""
        folder = self.queue.handles[number - 1].job.folder
        if state == "running":
            worker_lock.acquire(folder)
        else:
            worker_lock.release(folder)
        (folder / STATUS).write_text(encode_status(JobStatus(state, started=1000.0)))
        self.queue._update_jobs()

    def handle(self, number: int) -> JobHandle:
        found = self.queue.handle(number)
        assert found is not None
        return found

    def click(self, qtbot: QtBot, number: int, name: str) -> None:
        qtbot.mouseClick(self.panel.buttons_of[self.handle(number)].buttons[name], Qt.MouseButton.LeftButton)

    def click_row(self, qtbot: QtBot, place: int) -> None:
        box = self.panel.table.visualRect(self.panel.model.index(place, 0))
        qtbot.mouseClick(self.panel.table.viewport(), Qt.MouseButton.LeftButton, pos=box.center())

    def visible(self, number: int) -> set[str]:
        buttons = self.panel.buttons_of[self.handle(number)].buttons
        return {name for name, button in buttons.items() if button.isVisible()}


@pytest.fixture
def pipeline(tmp_path: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> Iterator[Pipeline]:
    jobs = JobList(tmp_path / "house.nvsim")
    for verb, title in zip(("train", "map", "evaluate graph"), TITLES, strict=True):
        job = jobs.add(verb, ["--project", str(jobs.root)], title)
        job.events.write_text(event_line(Log("Started."), 0.0) + event_line(Progress(verb, 1, 4, "a part"), 1.0))
    queue = JobQueue()
    panel = JobPanel(queue)
    qtbot.addWidget(panel)
    made = Pipeline(queue, panel)
    monkeypatch.setattr(nvsim_app.jobs.queue, "start_worker", lambda root, number, threads: made.started.append(number))
    queue.set_project(jobs.root)
    made.set(1, "running")
    panel.resize(1300, 240)
    panel.show()
    panel.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is panel, timeout=5000)
    yield made
    for handle in queue.handles:
        worker_lock.release(handle.job.folder)
    queue.set_project(None)


def test_rows_are_updated_in_place_while_a_job_runs(pipeline: Pipeline, qtbot: QtBot) -> None:
    model, events = pipeline.panel.model, pipeline.handle(1).job.events
    assert model.index(0, 2).data() == "25 %"
    events.write_text(events.read_text() + event_line(Progress("train", 2, 4, "a part"), 2.0))
    with qtbot.waitSignal(model.dataChanged), qtbot.assertNotEmitted(model.modelReset):
        pipeline.queue._update_jobs()
    assert model.index(0, 2).data() == "50 %"
    pipeline.panel.grab()  # paints the progress bars


def test_jobs_stand_in_the_order_in_which_they_run(pipeline: Pipeline) -> None:
    model = pipeline.panel.model
    assert [model.index(place, 0).data() for place in range(3)] == list(TITLES)
    for number, state in ((1, "done"), (2, "running")):
        pipeline.set(number, state)
    assert [model.index(place, 0).data() for place in range(3)] == list(TITLES)
    assert [model.index(place, 1).data() for place in range(3)] == ["done", "running", "queued"]


def test_continue_continues_the_paused_job_and_not_the_first_of_the_queue(pipeline: Pipeline, qtbot: QtBot) -> None:
    train = pipeline.handle(1)
    assert pipeline.visible(1) == {"pause", "cancel"}
    pipeline.click(qtbot, 1, "pause")
    assert (train.job.folder / WISH).read_text() == "pause"
    assert pipeline.visible(1) == {"pause", "cancel"}  # nothing moves to the place of the button that was clicked
    pipeline.set(1, "paused")
    assert pipeline.panel.handle is train  # the curves stay
    assert pipeline.visible(2) == pipeline.visible(3) == {"pause", "cancel"}  # they need the paused job
    reason = pipeline.panel.buttons_of[pipeline.handle(2)].commands["resume"].toolTip()
    assert "“Train” comes first" in reason
    pipeline.click(qtbot, 1, "resume")
    assert pipeline.started == [1]
    assert [handle.state for handle in pipeline.queue.handles] == ["queued"] * 3


def test_a_second_click_at_the_same_place_never_cancels(pipeline: Pipeline, qtbot: QtBot) -> None:
    panel = pipeline.panel
    panel.resize(1000, 240)  # some columns have no room, and come and go with the time that is left
    buttons = panel.buttons_of[pipeline.handle(1)].buttons
    place = buttons["pause"].mapTo(panel, buttons["pause"].rect().center())

    def click() -> None:
        qtbot.wait(50)  # until the buttons have moved
        target = panel.childAt(place)
        qtbot.mouseClick(target, Qt.MouseButton.LeftButton, pos=target.mapFrom(panel, place))

    click()
    click()  # while the job pauses
    assert (pipeline.handle(1).job.folder / WISH).read_text() == "pause"
    pipeline.set(1, "paused")
    qtbot.waitUntil(lambda: panel.childAt(place) is buttons["resume"], timeout=5000)
    click()
    assert pipeline.started == [1]


def test_a_waiting_job_is_continued_when_nothing_comes_before_it(pipeline: Pipeline, qtbot: QtBot) -> None:
    pipeline.set(1, "failed")
    assert pipeline.visible(2) == {"pause", "resume", "cancel"}
    pipeline.click(qtbot, 2, "resume")
    assert pipeline.started == [2]


def test_the_running_job_is_shown_until_another_one_is_selected(pipeline: Pipeline, qtbot: QtBot) -> None:
    panel = pipeline.panel
    assert panel.handle is pipeline.handle(1)
    pipeline.set(1, "done")
    pipeline.set(2, "running")
    assert panel.handle is pipeline.handle(2)
    pipeline.click_row(qtbot, 0)
    assert panel.handle is pipeline.handle(1)
    pipeline.set(2, "done")
    pipeline.set(3, "running")
    assert panel.handle is pipeline.handle(1)  # the user selected it
    qtbot.keyClick(panel.table, Qt.Key.Key_Down)
    assert panel.handle is pipeline.handle(2)
    qtbot.keyClick(panel.table, Qt.Key.Key_Down)
    assert panel.handle is pipeline.handle(3)  # the running one, which the panel follows again
    pipeline.set(3, "done")
    pipeline.set(1, "running")
    assert panel.handle is pipeline.handle(1)


def test_keys_reach_the_buttons_of_the_selected_row(pipeline: Pipeline, qtbot: QtBot) -> None:
    panel = pipeline.panel
    panel.table.setFocus()
    seen = set()
    for _ in range(12):
        widget = QApplication.focusWidget()
        assert widget is not None
        if widget is panel.buttons_of[pipeline.handle(1)].buttons["cancel"]:
            break
        seen.add(widget)
        qtbot.keyClick(widget, Qt.Key.Key_Tab)
    else:
        pytest.fail("Tab does not reach the button")
    others = panel.buttons_of[pipeline.handle(2)].buttons.values()
    assert not seen & set(others)
    qtbot.keyClick(widget, Qt.Key.Key_Space)
    assert (pipeline.handle(1).job.folder / WISH).read_text() == "cancel"


@pytest.mark.parametrize("width", [400, 540, 900])
def test_the_buttons_of_a_row_show_their_whole_texts(pipeline: Pipeline, qtbot: QtBot, width: int) -> None:
    panel = pipeline.panel
    panel.resize(2 * width, 300)
    panel.splitter.setSizes([width, width])
    pipeline.set(1, "failed")  # then the next job waits, with three buttons

    def whole() -> bool:
        shown = [b for n in (1, 2, 3) for b in panel.buttons_of[pipeline.handle(n)].buttons.values() if b.isVisible()]
        return len(shown) >= 4 and all(b.width() >= b.sizeHint().width() for b in shown)

    qtbot.waitUntil(whole)
    assert sum(button.isVisible() for button in panel.buttons_of[pipeline.handle(2)].buttons.values()) == 3


def test_all_tabs_are_visible_in_a_narrow_panel(pipeline: Pipeline, qtbot: QtBot) -> None:
    panel, bar = pipeline.panel, pipeline.panel.tabs.tabBar()
    panel.resize(500, 240)

    def whole() -> bool:
        last = bar.tabRect(panel.tabs.indexOf(panel.log))
        return bar.width() <= panel.tabs.width() and bar.rect().contains(last) and panel.width() == 500

    qtbot.waitUntil(whole)
    assert not panel.large.isVisible()
    where = bar.tabRect(panel.tabs.indexOf(panel.log)).center()
    qtbot.mouseClick(bar, Qt.MouseButton.LeftButton, pos=where)
    assert panel.tabs.currentWidget() is panel.log
    with qtbot.waitSignal(panel.largeWanted) as wanted:
        panel.buttons_of[pipeline.handle(1)].commands["enlarge"].trigger()
    assert wanted.args == [pipeline.handle(1)]
    panel.resize(1300, 240)
    qtbot.waitUntil(panel.large.isVisible)


def test_the_button_of_other_commands_is_visible_on_a_selected_row(pipeline: Pipeline, qtbot: QtBot) -> None:
    button = pipeline.panel.buttons_of[pipeline.handle(1)].more
    assert pipeline.panel.handle is pipeline.handle(1)
    image = button.grab().toImage()
    row = pipeline.panel.palette().highlight().color()
    background = image.pixelColor(button.width() // 2, 5)
    assert background.name() != row.name() and contrast(background, button.palette().buttonText().color()) > 4.5


def contrast(first: QColor, second: QColor) -> float:
    """The contrast of two colors as WCAG 2 defines it, 1 to 21."""

    def luminance(color: QColor) -> float:
        parts = (color.redF(), color.greenF(), color.blueF())
        red, green, blue = (v / 12.92 if v <= 0.03928 else ((v + 0.055) / 1.055) ** 2.4 for v in parts)
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue

    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


def test_the_other_commands_are_in_the_menu_of_the_row(pipeline: Pipeline, qtbot: QtBot) -> None:
    assert os.path.isdir(pipeline.handle(3).job.folder)
    buttons = pipeline.panel.buttons_of[pipeline.handle(3)]
    texts = {action.text(): action.isEnabled() for action in buttons.more.menu().actions()}
    assert texts == {"Enlarge…": False, "Settings…": False, "Show folder": False, "Copy command": True, "Remove": True}
    buttons.commands["copy"].trigger()
    assert QApplication.clipboard().text().startswith("nvsim evaluate graph --project ")
    buttons.commands["remove"].trigger()
    assert [handle.number for handle in pipeline.queue.handles] == [1, 2]
    assert pipeline.panel.handle is pipeline.handle(1)


def test_a_click_counts_if_the_list_changes_while_the_button_is_pressed(pipeline: Pipeline, qtbot: QtBot) -> None:
    jobs = JobList(pipeline.handle(1).job.folder.parent.parent.parent)
    assert [job.number for job in jobs.jobs()] == [1, 2, 3]
    pause = pipeline.panel.buttons_of[pipeline.handle(1)].buttons["pause"]
    assert QApplication.widgetAt(pause.mapToGlobal(pause.rect().center())) is pause
    qtbot.mousePress(pause, Qt.MouseButton.LeftButton)
    job = jobs.add("export splats", ["--project", str(jobs.root)], "Export")
    pipeline.queue.remove(pipeline.handle(3))
    pipeline.queue._update_jobs()
    assert [row.handle and row.handle.number for row in pipeline.panel.model.rows] == [1, 2, job.number]
    QApplication.processEvents()
    below = QApplication.widgetAt(pause.mapToGlobal(pause.rect().center()))
    assert below is pause and pause.isVisible()
    qtbot.mouseRelease(below, Qt.MouseButton.LeftButton)
    assert (pipeline.handle(1).job.folder / WISH).read_text() == "pause"
    assert pipeline.visible(job.number) == {"pause", "cancel"}


def test_removing_the_selected_job_shows_the_running_one(pipeline: Pipeline, qtbot: QtBot) -> None:
    pipeline.click_row(qtbot, 2)
    pipeline.queue.remove(pipeline.handle(3))
    assert pipeline.panel.handle is pipeline.handle(1)
    pipeline.set(1, "done")
    pipeline.click_row(qtbot, 0)
    pipeline.queue.remove(pipeline.handle(1))
    assert pipeline.panel.handle is pipeline.handle(2)
