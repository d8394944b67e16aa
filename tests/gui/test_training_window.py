"""A training in large: its steps beside the held-out photo, its curves, and those of another run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from PySide6.QtCore import QSettings, Qt
from pytestqt.qtbot import QtBot

from nvsim.events import Event, Metric, Preview, Progress
from nvsim.project.jobs.files import event_line
from nvsim.project.jobs.joblist import JobList
from nvsim.project.project import Project
from nvsim_app.jobs.history import JobReport
from nvsim_app.jobs.queue import JobQueue
from nvsim_app.look.notices import Notices
from nvsim_app.panels.job_plots import smoothed
from nvsim_app.panels.training_images import JobPreview
from nvsim_app.panels.training_window import TrainingWindow
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.wiring.jobs import JobsPart, TrainingPart
from nvsim_app.wiring.window import MainWindow

PHOTO, ALPHA, BACKGROUND = 30, 90, 150  # gray levels of what stays the same in the images


def trained(project: Path, run: str, steps: list[int], submap: int = 0, title: str = "Train") -> int:
    """A job that trained so far and was paused there: its curves, and an image of each step whose model is as bright
    as the step. Returns its number."""
    jobs = JobList(project)
    job = jobs.add("train", ["--project", str(project)], title)
    pictures = project / "pictures"
    pictures.mkdir(exist_ok=True)
    events: list[Event] = []
    for step in steps:
        picture = np.zeros((96, 128, 3), np.uint8)
        picture[:48, :64], picture[:48, 64:] = PHOTO, step
        picture[48:, :64], picture[48:, 64:] = ALPHA, BACKGROUND
        path = pictures / f"preview_{submap:03d}_{run}_{step:07d}.jpg"
        cv2.imwrite(str(path), picture)
        events += [
            Metric("train", name, float(step), step, submap) for name in ("loss", "psnr", "gaussians", "psnr_held_out")
        ]
        events.append(Preview("train", str(path), f"submap {submap}, step {step}: held-out photo", step, submap))
    events.append(Progress("train", steps[-1], 1000, "step"))
    job.events.write_text("".join(event_line(e, 1.0 + i) for i, e in enumerate(events)))
    jobs.ask(job.number, "pause")
    return job.number


@pytest.fixture
def project(tmp_path: Path) -> Path:
    with Project.create_or_open(tmp_path / "demo.nvsim") as made:
        return made.layout.root


@pytest.fixture
def shown(project: Path, qtbot: QtBot) -> Iterator[tuple[TrainingWindow, int, int]]:
    """The window on the later of two runs; the numbers of both."""
    first = trained(project, "a0", [20, 60, 100, 140])
    second = trained(project, "a1", [50, 100, 200])
    queue = JobQueue()
    queue.set_project(project)
    window = TrainingWindow(queue)
    window.show()
    qtbot.waitUntil(lambda: window.images.step == 200 and window.images.canvas._render is not None, timeout=10_000)
    yield window, first, second
    window.close()
    queue.set_project(None)


def levels(window: TrainingWindow) -> tuple[int, int]:
    """Grey of the two images on the canvas."""
    canvas = window.images.canvas
    return tuple(int(p.image.pixelColor(20, 20).red()) for p in (canvas._photo, canvas._render))  # type: ignore[union-attr]


def test_every_step_stands_beside_the_held_out_photo(shown, qtbot: QtBot) -> None:
    window, _, _ = shown
    assert levels(window) == pytest.approx((PHOTO, 200), abs=4)
    assert window.images.canvas._photo.size == (64, 48), "a quarter of the image, at its own size"
    window.images.slider.setValue(0)
    qtbot.waitUntil(lambda: levels(window)[1] == pytest.approx(50, abs=4), timeout=5000)
    assert "step 50" in window.images.words.text() and "held-out photo" in window.images.words.text()
    assert window.images.canvas.legends == []
    window.images.part.setCurrentText("Alpha")
    qtbot.waitUntil(lambda: levels(window)[1] == pytest.approx(ALPHA, abs=4), timeout=5000)
    (legend,) = window.images.canvas.legends
    assert legend.value_at(0.5, 0.5) == pytest.approx(ALPHA / 255, abs=0.02)
    for button in window.images.modes.buttons():
        qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
        window.images.canvas.grab()
    assert window.images.canvas.mode == "beside"


def test_the_newest_step_is_followed_unless_another_one_was_chosen(shown, project: Path, qtbot: QtBot) -> None:
    window, _, second = shown
    (handle,) = [h for h in window._queue.handles if h.number == second]

    def train_on(step: int) -> None:
        path = project / "pictures" / f"preview_000_a1_{step:07d}.jpg"
        cv2.imwrite(str(path), np.full((96, 128, 3), 240, np.uint8))
        with open(handle.job.events, "a") as file:
            file.write(event_line(Preview("train", str(path), "x", step, 0), 9.0))

    train_on(300)
    qtbot.waitUntil(lambda: window.images.step == 300, timeout=10_000)
    window.images.slider.setValue(window.images._steps.index(100))
    train_on(400)
    qtbot.waitUntil(lambda: window.images.slider.maximum() == 4, timeout=10_000)
    assert window.images.step == 100
    # A file that was let go is offered no more.
    (project / "pictures" / "preview_000_a1_0000050.jpg").unlink()
    train_on(500)
    qtbot.waitUntil(lambda: window.images._steps == [100, 200, 300, 400, 500], timeout=10_000)


def test_curves_say_what_they_measure_and_another_run_lies_dashed_beside_them(shown, qtbot: QtBot) -> None:
    window, first, second = shown
    plots = window.plots
    assert window.handle.number == second and window.other_handle is None
    for name, unit in (("loss", "loss"), ("psnr", "PSNR / dB"), ("psnr_held_out", "PSNR / dB")):
        axes = plots.plots[name].getAxis("left"), plots.plots[name].getAxis("bottom")
        assert [axis.labelText for axis in axes] == [unit, "step"] and all(axis.label.isVisible() for axis in axes)
    window.other.setCurrentIndex(window.other.findData(first))
    qtbot.waitUntil(lambda: ("psnr", "other", 0) in plots._curves, timeout=10_000)
    mine, theirs = plots._curves["psnr", "run", 0], plots._curves["psnr", "other", 0]
    assert list(theirs.getData()[0]) == [20, 60, 100, 140] and list(mine.getData()[0]) == [50, 100, 200]
    assert mine.opts["pen"].style() == Qt.PenStyle.SolidLine and theirs.opts["pen"].style() == Qt.PenStyle.DashLine
    assert "Dashed: Train" in window.legend.text()
    # And its image of the step that is nearest.
    qtbot.waitUntil(lambda: window.images.against.isVisible(), timeout=5000)
    window.images.slider.setValue(window.images._steps.index(50))
    window.images.against.setCurrentText("Other run")
    qtbot.waitUntil(lambda: levels(window) == pytest.approx((60, 50), abs=4), timeout=5000)
    assert window.images.canvas.names == {"photo": "Other run, step 60", "render": "Model, step 50"}
    window.other.setCurrentIndex(0)
    qtbot.waitUntil(lambda: ("psnr", "other", 0) not in plots._curves, timeout=5000)


def test_a_run_of_another_submap_says_that_it_has_no_curves_of_this(project: Path, qtbot: QtBot) -> None:
    other = trained(project, "a0", [10, 20], submap=1)
    trained(project, "a1", [10, 20], submap=0)
    queue = JobQueue()
    queue.set_project(project)
    window = TrainingWindow(queue)
    qtbot.addWidget(window)
    window.show()
    qtbot.waitUntil(lambda: window.submap.currentData() == 0, timeout=10_000)
    window.other.setCurrentIndex(window.other.findData(other))
    qtbot.waitUntil(lambda: "no curves of submap 0" in window.legend.text(), timeout=10_000)
    queue.set_project(None)
    qtbot.waitUntil(lambda: window.images.canvas._photo is None, timeout=5000)
    assert window.run.count() == 0
    window.close()


def test_smoothing_is_the_exponential_mean_and_leaves_what_was_measured_behind(shown) -> None:
    values = np.random.default_rng(2).normal(size=50)
    for weight in (0.0, 0.6, 0.95):
        powers = weight ** np.arange(50)
        expected = [(powers[: i + 1][::-1] * values[: i + 1]).sum() / powers[: i + 1].sum() for i in range(50)]
        assert smoothed(values, weight) == pytest.approx(expected)
    window, *_ = shown
    plots = window.plots
    assert ("psnr", "run as measured", 0) not in plots._curves
    window.smoothing.setValue(50)
    assert window.smoothed.text() == "0.50"
    assert list(plots._curves["psnr", "run as measured", 0].getData()[1]) == [50, 100, 200]
    assert plots._curves["psnr", "run", 0].getData()[1][1] == pytest.approx((0.5 * 50 + 100) / 1.5)
    held_out = plots._curves["psnr_held_out", "run", 0].getData()[1]
    assert list(held_out) == [50, 100, 200], "what has no noise is not smoothed"
    window.smoothing.setValue(0)
    assert ("psnr", "run as measured", 0) not in plots._curves


def test_what_came_after_a_checkpoint_is_no_image_of_the_run(tmp_path: Path) -> None:
    report = JobReport()
    for step in (10, 20, 30, 15):
        report.receive(0.0, Preview("train", f"{step}.jpg", "", step, 2))
    assert list(report.images["submap 2"]) == [10, 15]
    report.receive(0.0, Preview("train", "preview_001.jpg", "of an older version"))
    assert list(report.images) == ["submap 2", "preview_001.jpg"]


def test_the_small_preview_shows_the_newest_image_of_each_submap(project: Path, qtbot: QtBot) -> None:
    number = trained(project, "a0", [50, 100, 200])
    queue = JobQueue()
    queue.set_project(project)
    preview = JobPreview()
    qtbot.addWidget(preview)
    handle = queue.handle(number)
    preview.show_job(handle)
    preview.show()
    qtbot.waitUntil(lambda: bool(preview.pictures) or preview.refresh(), timeout=10_000)
    (pixmap,) = preview.pictures
    assert pixmap.toImage().pixelColor(100, 20).red() == pytest.approx(200, abs=4)
    queue.set_project(None)
    preview.close()


def test_the_jobs_panel_opens_it_and_it_comes_back_as_it_was_left(
    project: Path, settings: QSettings, qtbot: QtBot
) -> None:
    number = trained(project, "a0", [50, 100])
    document = Document()
    main = MainWindow(document, settings, Notices())
    qtbot.addWidget(main)
    main.show()
    assert not main.actions_table["training"].isEnabled()
    document.set_contents(Contents(project))
    assert main.actions_table["training"].isEnabled()
    panel, part = main.part(JobsPart).panel, main.part(TrainingPart)
    panel.choose(main.jobs.handle(number))
    qtbot.mouseClick(panel.large, Qt.MouseButton.LeftButton)
    window = part.window
    assert window is not None and window.isVisible() and window.handle.number == number
    assert main.actions_table["training"].trigger() is None and part.window is window, "there is one"
    window.smoothing.setValue(40)
    window.resize(700, 400)
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    assert part.window is None
    assert part.open_window().smoothing.value() == 40 and part.window.size().width() == 700
    main.close()
    assert part.window is None


def test_it_is_no_larger_than_the_screen(qtbot: QtBot) -> None:
    window = TrainingWindow(JobQueue())
    qtbot.addWidget(window)
    room = window.screen().availableSize()
    assert window.width() < room.width() and window.height() < room.height()
