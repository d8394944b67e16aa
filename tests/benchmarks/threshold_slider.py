"""Measure the time of a threshold slider step in the window, until the map and the 3D view are redrawn.

QT_QPA_PLATFORM=offscreen python -m tests.benchmarks.threshold_slider

Every edge disappears, which is the largest possible change.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QApplication

from nvsim_app.look.notices import Notices
from nvsim_app.start.application import make_application
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.wiring.thresholds import ThresholdPart
from nvsim_app.wiring.window import MainWindow
from tests.benchmarks.harness import report, timed, times
from tests.benchmarks.redecide import field


def turns(done: Callable[[], bool], least: float = 0.0) -> float:
    """Runs the event loop until `done`, for at least `least` seconds. Returns its longest iteration in milliseconds."""
    longest, end = 0.0, time.perf_counter() + least
    while time.perf_counter() < end or not done():
        begin = time.perf_counter()
        QApplication.processEvents()
        longest = max(longest, time.perf_counter() - begin)
        time.sleep(0.001)
    return 1e3 * longest


def measured_on(side: int, settings: QSettings) -> dict[str, object]:
    """The figures of a graph of side x side viewpoints, in a window of 1280x720."""
    document = Document()
    window = MainWindow(document, settings, Notices())
    window.resize(1280, 720)
    window.show()
    document.set_contents(Contents(Path("field.nvsim"), graph=field(side)))
    part = window.part(ThresholdPart)
    part.show_panel()
    window.scene.places.show_overview()
    turns(lambda: True, 1.5)

    def prepare() -> float:
        part.trial.prepare()
        return turns(lambda: part.trial.redecider is not None)

    longest, prepared = timed(prepare)
    deciding = []

    def slide(step: int) -> None:
        before = part.trial.outcome
        part.panel.rows["row_alpha"].slider.setValue(4 + step % 2)
        while part.trial.outcome is before:
            QApplication.processEvents()
        QApplication.processEvents()  # paint the result of the decision
        deciding.append(part.trial.milliseconds)

    whole = times(slide, 30)
    window.close()
    return {
        "viewpoints": side * side,
        "prepare_s": round(prepared, 2),
        "longest_turn_while_preparing_ms": round(longest),
        "step_ms": round(statistics.median(whole[1:]), 1),
        "step_max_ms": round(max(whole[1:]), 1),
        "deciding_ms": round(statistics.median(deciding[1:]), 1),
    }


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        settings = QSettings(f"{folder}/window.ini", QSettings.Format.IniFormat)
        make_application("dark", settings)
        for side in (32, 100):
            report(measured_on(side, settings), as_json=True)


if __name__ == "__main__":
    main()
