"""Takes the pictures of the window in resources/docs, on a copy of a project that `nvsim demo` made:

xvfb-run -a -s "-screen 0 2600x1600x24" python packaging/pictures.py demo.nvsim [--out resources/docs]

Each picture is taken twice, with two pixels per point: NAME.webp in the dark theme and NAME-light.webp in the light
theme. The pages name the first; the site shows the one that fits the theme of the reader.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from PIL import Image
from PySide6.QtCore import QSettings, Qt
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QApplication, QDockWidget

from nvsim_app.agent.state import AgentState
from nvsim_app.look import theme
from nvsim_app.panels.jobs import JobPanel
from nvsim_app.panels.results import ResultPanel
from nvsim_app.session import Session
from nvsim_app.start.application import make_application
from nvsim_app.thresholds.calibration_panel import CalibrationPanel
from nvsim_app.wiring.agent import AgentPart
from nvsim_app.wiring.frames import FramePart
from nvsim_app.wiring.inspector import InspectorPart
from nvsim_app.wiring.jobs import JobsPart

SIZE = (1280, 780)
SCALE = 2  # pixels per point
QUALITY = 78  # of WebP
SECONDS = 240.0
WANT = 0.97  # the validity that a suggestion must surely have; the building is too small for more
TRAINING = ["--steps", "900", "--image-size", "320"]


class Camera:
    """Brings the window to what is to be seen, and takes pictures of it."""

    def __init__(self, session: Session, out: Path) -> None:
        self.session, self.window, self.out = session, session.window, out
        self.table = session.window.actions_table

    def until(self, what: Callable[[], object], seconds: float = SECONDS) -> None:
        end = time.monotonic() + seconds
        while not what() and time.monotonic() < end:
            QApplication.processEvents()
            time.sleep(0.005)

    def rest(self) -> None:
        scene = self.window.scene
        self.until(lambda: False, 0.6)
        self.until(lambda: scene.picture is not None and not scene.drawing)
        self.until(lambda: False, 0.3)

    def take(self, name: str) -> None:
        """Saves the window in the dark theme, and then in the light one."""
        for theme_suffix in ("", "-light"):
            self.rest()
            image = self.window.grab().toImage().convertToFormat(QImage.Format.Format_RGB888)
            size = (image.width(), image.height())
            picture = Image.frombytes("RGB", size, bytes(image.constBits()), "raw", "RGB", image.bytesPerLine())
            path = self.out / f"{name}{theme_suffix}.webp"
            picture.save(path, quality=QUALITY, method=6)
            print(path, path.stat().st_size // 1024, "KiB", flush=True)
            self.table["dark"].trigger()

    def docks(self, **heights: int) -> None:
        """Gives panels, by name, so many pixels of height."""
        docks = [self.window.findChild(QDockWidget, f"dock_{name}") for name in heights]
        self.window.resizeDocks(docks, list(heights.values()), Qt.Orientation.Vertical)
        self.until(lambda: False, 0.3)
        self.window.panels["map"].frame_everything()


def shoot(camera: Camera) -> None:
    session, window, table = camera.session, camera.window, camera.table
    document = session.document
    camera.until(lambda: document.graph is not None and window.scene.picture is not None)
    ids = document.graph_arrays.ids

    window.show_dock("tables")
    camera.docks(tables=120)
    table["overview"].trigger()
    camera.take("window")

    document.select(frame=60)
    table["open_frame"].trigger()
    page = window.part(FramePart).browser.page
    camera.until(lambda: page.canvas._render is not None)
    camera.take("window-frame")
    table["leave_frame"].trigger()

    document.select(viewpoint=max(ids, key=lambda id: len(document.graph.neighbors(id))))
    table["focus"].trigger()
    camera.rest()
    table["show_trajectory"].trigger()
    table["inspect"].trigger()
    camera.docks(map=230, details=470)
    inspector = window.part(InspectorPart)
    camera.until(lambda: inspector.panoramas.current is not None and not inspector.panoramas.drawing)
    directions = inspector.panel.model
    row = next(i for i, found in enumerate(directions.rows) if found.outcome_label.startswith("blocked"))
    inspector.panel.list.setCurrentIndex(directions.index(row, 0))
    camera.take("window-inspector")

    walk_as_an_agent(camera)

    document.select()
    table["home"].trigger()
    table["thresholds"].trigger()
    panel = window.panels["thresholds"]
    for alpha in (0.05, 0.02, 0.01, 0.0):  # the strictest limits change every graph
        panel.rows["tau_alpha"].figure.setValue(alpha)
        camera.until(lambda: panel.apply.isEnabled(), 10)
        if panel.apply.isEnabled():
            break
    camera.take("window-thresholds")
    panel.reset.click()

    calibration = window.panels["calibration"]
    assert isinstance(calibration, CalibrationPanel)
    calibration.want.setValue(WANT)
    table["calibration"].trigger()
    camera.docks(calibration=300)
    camera.until(lambda: calibration.model.rowCount() > 1)
    calibration.list.setCurrentIndex(calibration.model.index(calibration.model.rowCount() - 1, 0))
    camera.take("window-calibration")

    camera.docks(jobs=250)
    part = window.part(JobsPart)
    handle = part.run_stage("evaluate views")
    assert handle is not None
    camera.until(lambda: handle.state in ("done", "failed"))
    window.show_dock("results")
    results = window.panels["results"]
    assert isinstance(results, ResultPanel)
    camera.until(lambda: results.tables.count() > 1)
    results.tables.setCurrentIndex(results.tables.count() - 1)
    camera.until(lambda: not window.notice_area.texts, 30)
    camera.take("window-results")

    train_a_submap(camera)


def train_a_submap(camera: Camera) -> None:
    """Trains the last submap again, and takes the picture when most of its steps are done."""
    window, project = camera.window, camera.session.document.project
    jobs = window.panels["jobs"]
    assert isinstance(jobs, JobPanel)
    submap = max(camera.session.document.contents.model_info)
    arguments = ["--project", str(project), "--submaps", str(submap), *TRAINING]
    handle = window.jobs.start("train", arguments, project, f"Train submap {submap}")
    camera.docks(jobs=250)
    window.show_dock("jobs")
    jobs.splitter.setSizes([536, 464])
    camera.table["home"].trigger()
    camera.until(lambda: handle.history.share > 0.7 or handle.state in ("done", "failed"))
    camera.take("window-training")
    window.jobs.cancel(handle)
    camera.until(lambda: handle.state not in ("running", "queued"))


def walk_as_an_agent(camera: Camera) -> None:
    """Three steps ahead from a viewpoint in the middle of the list, then a turn to where most can be gone to."""
    window, document = camera.window, camera.session.document
    ids = document.graph_arrays.ids
    document.select(viewpoint=ids[len(ids) // 3])
    window.actions_table["mode_agent"].trigger()
    walk = window.part(AgentPart).walk

    def now() -> AgentState:
        camera.until(lambda: walk.state is not None and not walk.drawing)
        assert walk.state is not None
        return walk.state

    for _ in range(3):
        for _ in range(12):
            new = [
                p for p in now().navigableLocations[1:] if p.viewpointId not in {t.viewpoint for t in walk.trajectory}
            ]
            if new:
                walk.take_viewpoint(new[0].viewpointId)
                break
            walk.turn(1, 0)
    seen = []
    for _ in range(12):
        seen.append(len(now().navigableLocations))
        walk.turn(1, 0)
    for _ in range(seen.index(max(seen))):
        now()
        walk.turn(1, 0)
    now()
    window.panels["map"].frame_everything()
    camera.take("window-agent")
    window.actions_table["cancel"].trigger()


def take(shoot: Callable[[Camera], None], about: str | None, size: tuple[int, int]) -> None:
    """Runs `shoot` on a window of that size with a copy of the project that the command line names."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("project", type=Path)
    parser.add_argument("--out", type=Path, default=Path("resources/docs"))
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        project = Path(shutil.copytree(given.project, Path(folder) / "demo.nvsim"))
        shutil.rmtree(project / "logs", ignore_errors=True)  # they tell how busy the machine was that made the project
        os.environ["QT_SCALE_FACTOR"] = str(SCALE)
        settings = QSettings(f"{folder}/window.ini", QSettings.Format.IniFormat)
        application = make_application("dark", settings)
        theme.apply(application, "dark")
        session = Session(settings)
        session.window.resize(*size)
        session.window.show()
        session.open(project)
        try:
            given.out.mkdir(parents=True, exist_ok=True)
            shoot(Camera(session, given.out))
        finally:
            session.close()


if __name__ == "__main__":
    sys.exit(take(shoot, __doc__, SIZE))
