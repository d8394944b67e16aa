"""The scale of a project is set by a length that the user measures in the window and knows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPointF, Qt
from pytestqt.qtbot import QtBot

from nvsim.capture.store import save_capture
from nvsim.capture.types import Cloud
from nvsim.cli.main import main
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim_app.painting import cameras
from nvsim_app.panels.form import KnownLength, outdated_results_text
from nvsim_app.session import Session
from nvsim_app.state.document import Document
from nvsim_app.state.loading import with_derived_arrays
from nvsim_app.views.graph_surface import SceneSurface
from nvsim_app.wiring.importing import ReimportPart, _config_of, options_of, without_option
from nvsim_app.wiring.modes import ModePart
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.window import MainWindow
from tests.unit import textured_room

SECONDS = 120_000
LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project with a capture of unknown scale, imported as if a unit were half a meter."""
    poses = textured_room.walk(12)
    capture = textured_room.write_capture(tmp_path, textured_room.write_images(tmp_path / "images", poses), poses)
    root = tmp_path / "house.nvsim"
    arguments = ["import", str(capture), "--project", str(root), "--scale", "0.5", "--hold-out", "5"]
    assert main([*arguments, "--poses", "given"]) == 0
    return root


@pytest.fixture
def session(session: Session) -> Session:
    session.window.resize(1500, 950)
    return session


def test_two_clicks_on_the_map_and_the_true_length_set_the_scale(qtbot: QtBot, session: Session, project: Path) -> None:
    session.open(project)
    document, window = session.document, session.window
    qtbot.waitUntil(lambda: document.contents.capture is not None, timeout=SECONDS)
    assert document.graph is None  # before a map is built
    window.actions_table["set_scale"].trigger()
    assert window.modes.current.name == "measure" and "distance you know" in window.statusBar().currentMessage()
    plan = window.part(MapPart).view
    plan.frame_everything()
    qtbot.wait(50)
    ends = document.trajectory.positions[[0, 6]]
    for pixel in plan.to_pixels(ends[:, :2]):
        qtbot.mouseClick(plan.canvas, LEFT, pos=QPointF(*pixel).toPoint())
    apart = float(np.linalg.norm(np.diff(ends[:, :2], axis=0)))
    assert window.modes.current.meters == pytest.approx(apart, rel=0.05)
    qtbot.keyClick(plan.plot, Qt.Key.Key_Return)
    (dialog,) = window.findChildren(KnownLength)
    dialog.length.setValue(2 * dialog.length.value())
    assert "200.0 %" in dialog.change.text() and dialog.words.text().endswith("is imported again.")
    qtbot.mouseClick(dialog.apply, LEFT)
    qtbot.waitUntil(lambda: document.contents.capture.alignment.scale == pytest.approx(1.0, rel=1e-3), timeout=SECONDS)
    assert document.trajectory.positions[[0, 6]] == pytest.approx(2 * ends, rel=1e-3)
    job = window.jobs.handles[-1]
    assert list(job.job.order.arguments[3:]) == [
        "--scale",
        job.job.order.arguments[4],
        "--hold-out",
        "5",
        "--poses",
        "given",
    ]
    qtbot.waitUntil(lambda: job.state == "done", timeout=SECONDS)


def test_a_frame_is_left_out_of_a_project(qtbot: QtBot, session: Session, project: Path) -> None:
    session.open(project)
    document, window = session.document, session.window
    qtbot.waitUntil(lambda: document.contents.capture is not None, timeout=SECONDS)
    assert not window.actions_table["leave_out_frame"].isEnabled()
    name = document.contents.capture.frames[3].name
    document.select(frame=3)
    window.actions_table["leave_out_frame"].trigger()
    qtbot.waitUntil(lambda: len(document.contents.capture.frames) == 11, timeout=SECONDS)
    assert name not in {frame.name for frame in document.contents.capture.frames}
    assert document.contents.capture.alignment.scale == 0.5
    job = window.jobs.handles[-1]
    qtbot.waitUntil(lambda: job.state == "done", timeout=SECONDS)


def test_the_results_that_a_new_scale_outdates_are_named() -> None:
    said = outdated_results_text({"import", "submaps", "floors", "map"})
    assert "These results become out of date: submaps, floor masks and navigation graph." in said


def test_an_option_is_removed_in_both_notations() -> None:
    words = ["--scale", "2", "--model", "1", "--model=0", "--models", "x", "--leave-out=--model"]
    assert without_option(words, "--model") == ["--scale", "2", "--models", "x", "--leave-out=--model"]


def test_the_options_of_an_import_are_those_it_was_made_with() -> None:
    assert options_of(CaptureConfig()) == []
    assert options_of(CaptureConfig(scale=0.5, leave_out="a.jpg")) == ["--scale", "0.5", "--leave-out", "a.jpg"]


def test_an_assumed_camera_height_is_no_option_of_the_next_import(project: Path) -> None:
    with Project.open(project) as opened:
        capture = opened.capture()
        assert capture is not None
        source = str(capture.source)
    height = ["--camera-height", "1.5"]
    assert main(["import", source, "--project", str(project), "--scale", "0.5", *height, "--poses", "given"]) == 0
    assert "--camera-height" in options_of(_config_of(project))
    with Project.open(project) as opened:
        capture = opened.capture()
        assert capture is not None
        assumed = replace(capture, alignment=replace(capture.alignment, scale_known=False))
        save_capture(assumed, opened.layout.imported)
    assert options_of(_config_of(project)) == ["--scale", "0.5", "--poses", "given"]


def test_measuring_snaps_to_the_point_cloud_while_it_is_shown(window: MainWindow, document: Document) -> None:
    points = np.array([[2.0, 4.0, 2.4], [6.0, 4.0, 0.3]], np.float32)
    document.set_contents(with_derived_arrays(replace(document.contents, cloud=Cloud(points, kind="images"))))
    window.scene.navigation.set_pose(cameras.top_view(document.extent, 1.4))
    surface = window.part(ModePart).stage.canvases[0].surface
    assert isinstance(surface, SceneSurface)
    pixels, _ = surface.project(points.astype(float))
    assert surface.pick_point(QPointF(*pixels[0])) is None
    window.scene.overlays.set_shown("cloud", True)
    assert surface.pick_point(QPointF(*pixels[0])) == pytest.approx((2.0, 4.0, 2.4))
    assert surface.pick_point(QPointF(*pixels[0]) + QPointF(30, 0)) is None
    assert window.part(ReimportPart).mode.on_confirm is not None
