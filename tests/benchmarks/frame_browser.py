"""Measure the response times of the frame browser: `python -m tests.benchmarks.frame_browser`.

It prints medians and 99th percentiles in milliseconds for scrolling 2,000 frames, for a brush step on an image of
1920x1440, and for growing a region."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
sys.path.insert(0, str(Path(__file__).parents[1] / "gui"))

import cv2  # noqa: E402
import demo_room  # noqa: E402
import numpy as np  # noqa: E402
from PySide6.QtCore import QPoint, Qt  # noqa: E402
from PySide6.QtTest import QTest  # noqa: E402
from PySide6.QtWidgets import QApplication  # noqa: E402

from nvsim.perception.regions import grow_region  # noqa: E402
from nvsim.project.layout import Layout  # noqa: E402
from nvsim_app.frames import pictures  # noqa: E402
from nvsim_app.frames.canvas import Canvas  # noqa: E402
from nvsim_app.frames.correction import Correction  # noqa: E402
from nvsim_app.frames.layers import standard_layers  # noqa: E402
from nvsim_app.frames.link import FrameLink  # noqa: E402
from nvsim_app.frames.tools import Brush  # noqa: E402
from nvsim_app.frames.worker import thumbnail_path  # noqa: E402
from nvsim_app.panels.frames import FramePanel  # noqa: E402
from nvsim_app.state.document import Document  # noqa: E402
from nvsim_app.state.loading import Contents  # noqa: E402
from tests.benchmarks.harness import times  # noqa: E402

LEFT, NONE = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier


def step_times(step: Callable[[int], object], count: int) -> str:
    taken = times(step, count)
    return f"median {np.median(taken):6.2f}   99 % {np.quantile(taken, 0.99):6.2f}   max {max(taken):6.2f} ms"


def scrolling(folder: Path) -> str:
    """Scrolls through frames whose thumbnails are on disk but not loaded. Each step shows a page of new ones."""
    walk = demo_room.capture(2000)
    rng = np.random.default_rng(0)
    for frame in walk.frames:
        path = thumbnail_path(Layout(folder), frame)
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), cv2.resize(rng.integers(0, 255, (12, 16, 3), np.uint8), (160, 120)))
    document = Document()
    document.set_contents(Contents(folder, walk, demo_room.submaps(walk)))
    panel = FramePanel(document, FrameLink())
    panel.resize(330, 900)
    panel.show()
    bar = panel.list.verticalScrollBar()

    def step(i: int) -> None:
        bar.setValue(bar.maximum() * i // 300)
        QApplication.processEvents()

    found = step_times(step, 300)
    panel.close()
    return found


def brushing() -> str:
    """Moves a brush of 60 pixels radius over a photo with its mask, fitted into 1100x800. The time is from a mouse
    event to the painted change."""
    layers = standard_layers()
    floor = next(layer for layer in layers if layer.name == "floor")
    image = np.random.default_rng(0).integers(0, 255, (1440, 1920, 3), np.uint8)
    mask = np.zeros((1440, 1920), bool)
    correction = Correction(mask, mask)
    canvas = Canvas(layers)
    floor.painted = pictures.tint(mask, floor.color)
    canvas.show_photo(pictures.photo(image), keep_zoom=False)
    canvas.set_mode("photo")

    def painted(box: object) -> None:
        pictures.repaint_mask(floor.painted, correction.mask, floor.color, box)
        canvas.refresh(box)

    brush = Brush(painted, lambda: None, lambda _: None, canvas.update)
    brush.set_correction(correction)
    brush.radius = 60.0
    canvas.tool = brush
    canvas.resize(1100, 800)
    canvas.show()
    QApplication.processEvents()
    QTest.mousePress(canvas, LEFT, NONE, QPoint(100, 100))

    def step(i: int) -> None:
        QTest.mouseMove(canvas, QPoint(100 + 7 * (i % 120), 100 + 2 * i))
        QApplication.processEvents()

    found = step_times(step, 240)
    canvas.close()
    return found


def growing() -> str:
    camera = demo_room.capture(8).frames[2].camera
    view = demo_room.cast(camera)
    image = (view.rgb * 255).clip(0, 255).astype(np.uint8)
    points, inside = np.array([(320.0, 460.0), (200.0, 440.0)]), np.array([True, False])
    return step_times(lambda _: grow_region(view.normal, image, points, inside), 30)


def main() -> None:
    application = QApplication(sys.argv[:1])
    with tempfile.TemporaryDirectory() as folder:
        print("scrolling 2,000 frames by a page    ", scrolling(Path(folder)))
    print("a step of the brush on 1920x1440    ", brushing())
    print("growing from two points on 640x480  ", growing())
    application.quit()


if __name__ == "__main__":
    main()
