"""The whole job in a real window, as a person does it, by its buttons, menus and forms: a new project from a capture,
checked, trained with settings of one's own, mapped, looked at, evaluated and exported. Run as a program, because Qt's
platform is chosen once per process: scenario_window.py CAPTURE FOLDER; prints what it saw as JSON."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import psutil
from PySide6.QtCore import QPoint, QSettings, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from nvsim_app.benchmarks.window import GapRecorder
from nvsim_app.forms.form import CommandForm
from nvsim_app.inspector.panel import InspectorPanel
from nvsim_app.panels.frames import FramePanel
from nvsim_app.panels.jobs import JobPanel
from nvsim_app.panels.new_project import NewProjectDialog
from nvsim_app.panels.results import ResultPanel
from nvsim_app.panels.stages import StageBar
from nvsim_app.session import Session
from nvsim_app.start.application import make_application
from nvsim_app.thresholds.panel import ThresholdPanel
from nvsim_app.wiring.frames import FramePart
from nvsim_app.wiring.inspector import InspectorPart

SECONDS = 150.0
LEFT = Qt.MouseButton.LeftButton


def until(what: Callable[[], object], name: str) -> None:
    """Lets the window live until it is so."""
    end = time.monotonic() + SECONDS
    while not what():
        QApplication.processEvents()
        time.sleep(0.005)
        if time.monotonic() > end:
            raise SystemExit(f"it never came to: {name}")


def fill(form: CommandForm, values: dict[str, str]) -> None:
    form.finish_building()
    for path, text in values.items():
        line = form.rows[path].editor.line
        line.selectAll()
        QTest.keyClicks(line, text)


def play(session: Session, capture: Path, folder: Path) -> dict[str, object]:
    window, seen = session.window, {}
    jobs, table = window.jobs, window.actions_table
    panel, results = window.panels["jobs"], window.panels["results"]
    assert isinstance(panel, JobPanel) and isinstance(results, ResultPanel)

    # A new project, from the button of the empty window.
    QTest.mouseClick(window.start.new, LEFT)
    (dialog,) = window.findChildren(NewProjectDialog)
    QTest.keyClicks(dialog.capture, str(capture))
    dialog.project.selectAll()
    QTest.keyClicks(dialog.project, str(folder / "rooms.nvsim"))
    until(dialog.import_button.isEnabled, "a checked capture")
    seen["verdict"] = dialog.verdict.text()
    QTest.mouseClick(dialog.import_button, LEFT)
    until(lambda: session.document.contents.capture is not None, "the import")

    # Each stage with settings of one's own.
    def run(verb: str, values: dict[str, str]) -> object:
        action = table[f"job_{verb.replace(' ', '_')}"]
        until(action.isEnabled, f"{verb} can be started")
        action.trigger()
        form = window.findChildren(CommandForm)[-1]
        fill(form, values)
        QTest.qWait(350)
        seen[f"command {verb}"] = form.command.text()
        QTest.mouseClick(form.start_button, LEFT)
        until(lambda: not form.isVisible(), "the form to close")
        return jobs.handles[-1]

    def done(handle: object) -> None:
        until(lambda: handle.state in ("done", "failed"), f"{handle.title} ended")
        if handle.state == "failed":
            raise SystemExit(f"{handle.title}: {handle.message}")

    done(run("submaps", {"config.count": "1"}))
    (bar,) = window.findChildren(StageBar)
    until(lambda: bar.isVisible() and "floor" in bar.stage.text(), "the next stage is offered")
    QTest.mouseClick(bar.stage, LEFT)  # the floor, from the bar over the view
    done(jobs.handles[-1])
    # Long enough for a picture of the model in training, which comes after 10 s.
    training = run("train", {"config.steps": "2400", "config.image_size": "128", "config.gaussian_cap": "6000"})
    until(lambda: training.history.share > 0.02, "the first steps")
    probe = GapRecorder(window)
    probe.start()
    until(lambda: window.scene.picture is not None or training.state == "done", "the model in training in the view")
    seen["live"] = training.state == "running" and window.scene.picture is not None
    until(lambda: training.state == "done", "the end of the training")
    probe.stop()
    seen["gap_p99_ms"] = probe.quantile(0.99)
    panel.choose(training)
    panel.plots.draw()
    seen["curves"] = sorted({name for name, *_ in panel.plots._curves})
    done(run("map", {"config.max_viewpoints": "8"}))
    until(lambda: session.document.contents.graph is not None, "the graph")
    until(lambda: window.scene.picture is not None and not window.scene.drawing, "the finished model in the view")

    # Inspect: a click on a viewpoint in the 3D view.
    table["above"].trigger() if "above" in table.actions else window.scene.places.look_from_above()
    until(lambda: not window.scene.drawing and window.scene.picture is not None, "the view from above")
    QTest.qWait(400)
    arrays = session.document.graph_arrays

    def click_a_viewpoint() -> bool:
        """The eye may still be on its way up, so the place is found anew for each click."""
        for position in arrays.positions:
            place = _pixel(window.scene.overlay_camera, position)
            if place is not None and window.scene.rect().adjusted(20, 20, -20, -60).contains(place):
                QTest.mouseMove(window.scene, place)
                QTest.mouseClick(window.scene, LEFT, pos=place)
                QTest.qWait(100)
                if session.document.selection.viewpoint is not None:
                    return True
        QTest.qWait(300)
        return False

    until(click_a_viewpoint, "a viewpoint that is clicked is selected")
    seen["selected"] = session.document.selection.viewpoint
    seen["viewpoints"] = len(arrays.ids)
    look_closer(session, seen)

    # Evaluate, then export.
    done(run("evaluate floor", {"truth": str(capture.parent / "ground_truth")}))
    until(lambda: results.results, "the result")
    seen["result"] = results.results[0].title
    done(run("export r2r", {"out": str(folder / "connectivity")}))
    seen["exported"] = sorted(p.name.partition("_")[2] or p.name for p in (folder / "connectivity").iterdir())
    QTest.qWait(300)
    window.grab().save(str(folder / "scenario.png"))
    return seen


def look_closer(session: Session, seen: dict[str, object]) -> None:
    """Why a direction is open or not; other thresholds, taken and taken back; a frame beside its render; and back."""
    window, table = session.window, session.window.actions_table
    inspector, thresholds, frames = (window.panels[name] for name in ("inspector", "thresholds", "frames"))
    assert isinstance(inspector, InspectorPanel) and isinstance(thresholds, ThresholdPanel)
    assert isinstance(frames, FramePanel)
    part = window.part(InspectorPart)
    table["inspect"].trigger()
    until(lambda: part.panoramas.current is not None and not part.panoramas.drawing, "the sharp panorama")
    until(lambda: inspector.model.rowCount() >= 8, "its directions")
    first = inspector.list.visualRect(inspector.model.index(0, 0))
    QTest.mouseClick(inspector.list.viewport(), LEFT, pos=first.center())
    seen["sentence"] = inspector.sentence.text()

    edges = len(session.document.graph.edges)
    table["thresholds"].trigger()
    figure = thresholds.rows["tau_alpha"].figure
    figure.selectAll()
    QTest.keyClicks(figure, "0.00")
    QTest.keyClick(figure, Qt.Key.Key_Return)
    until(thresholds.apply.isEnabled, "other thresholds change edges")
    seen["outcome"] = thresholds.outcome.text()
    QTest.mouseClick(thresholds.apply, LEFT)
    until(lambda: len(session.document.graph.edges) != edges, "the thresholds are applied")
    table["undo"].trigger()
    until(lambda: len(session.document.graph.edges) == edges, "and taken back")

    page = window.part(FramePart).browser.page
    until(lambda: not window.document.views.pending, "the view at rest")
    row = frames.list.visualRect(frames.model.index(0, 0))
    QTest.mouseClick(frames.list.viewport(), LEFT, pos=row.center())
    QTest.mouseDClick(frames.list.viewport(), LEFT, pos=row.center())
    until(lambda: page.isVisible() and page.canvas._render is not None, "the frame beside its render")
    table["frame_difference"].trigger()
    until(lambda: "difference" in table["view_back"].text(), "the compare mode can be undone")
    while page.isVisible():
        assert table["view_back"].isEnabled()
        table["view_back"].trigger()
    seen["back"] = page.canvas.mode


def _pixel(camera: object, position: object) -> QPoint | None:
    import numpy as np

    inside = np.linalg.inv(camera.camera_to_world) @ [*position, 1.0]
    if inside[2] <= 0.05:
        return None
    k = camera.intrinsics
    return QPoint(round(k.fx * inside[0] / inside[2] + k.cx), round(k.fy * inside[1] / inside[2] + k.cy))


if __name__ == "__main__":
    given, folder = Path(sys.argv[1]), Path(sys.argv[2])
    settings = QSettings(str(folder / "window.ini"), QSettings.Format.IniFormat)
    application = make_application("dark", settings)
    session = Session(settings)
    session.window.show()
    seen = play(session, given, folder)
    session.close()
    QTest.qWait(500)
    seen["threads"] = [t.name for t in threading.enumerate() if t is not threading.main_thread()]
    repeating = [t for t in session.window.findChildren(QTimer) if t.isActive() and not t.isSingleShot()]
    seen["timers"] = [t.objectName() or str(t.parent()) for t in repeating]
    children = [p for p in psutil.Process().children(recursive=True) if p.status() != psutil.STATUS_ZOMBIE]
    # Python's own resource tracker lives as long as the program.
    seen["processes"] = [p.name() for p in children if "resource_tracker" not in " ".join(p.cmdline())]
    print(json.dumps(seen))
