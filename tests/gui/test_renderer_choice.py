"""The choice of the renderer: by measured times, by the setting of the user, and by errors."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import demo_project
import numpy as np
import pytest
from PySide6.QtCore import QSettings
from pytestqt.qtbot import QtBot

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.types import Gaussians, SubmapModel
from nvsim_app.drawing.painter import NEUTRAL, LogRemark, Models, Painter
from nvsim_app.drawing.picture_feed import RenderLink
from nvsim_app.drawing.render_child import ProjectSource, Request
from nvsim_app.drawing.renderer_choice import AUTOMATIC, CPU, OPENGL, ROUNDS, RendererChoice
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.state.document import Document
from nvsim_app.wiring.window import MainWindow

CAMERA = ViewPose((7.0, 4.5, 1.5), 0.4).camera(80, 60)
MODEL = SubmapModel(demo_project.gaussians(300), None, demo_project.floor_texture(), FloorSurface.flat(0.0))
BLUE = (250, 20, 10)


class FakeCard:
    """An OpenGL renderer that paints everything blue."""

    name = "a card of this test"

    def __init__(self, fails: int = 1 << 30) -> None:
        self.left = fails
        self.sizes: list[tuple[int, int]] = []

    def render_bgrx(self, model: SubmapModel, camera: Camera, backdrop: tuple[float, float, float]) -> np.ndarray:
        self.left -= 1
        if self.left < 0:
            raise RuntimeError("the driver was reset")
        k = camera.intrinsics
        self.sizes.append((k.width, k.height))
        return np.tile(np.array([*BLUE, 255], np.uint8), (k.height, k.width, 1))

    def release(self) -> None:
        self.left = 0


def nowhere() -> FakeCard:
    raise InputError("OpenGL 3.3 cannot be used here (no such file); install a graphics driver.")


def painter(make: Callable[[], FakeCard], model: SubmapModel = MODEL) -> Painter:
    return Painter(Models(lambda camera: (4, model)), make)


def timed(times: dict[str, float], submap: int = 0) -> RendererChoice:
    choice = RendererChoice()
    while (name := choice.to_time(submap)) is not None:
        choice.add(submap, name, times[name])
    return choice


def test_the_faster_one_draws() -> None:
    assert timed({CPU: 15.0, OPENGL: 3.0}).faster(0) == OPENGL
    assert timed({CPU: 15.0, OPENGL: 60.0}).faster(0) == CPU


def test_a_slow_first_frame_decides_nothing() -> None:
    choice = RendererChoice()
    for ms in (400.0, 3.0, 3.0):
        choice.add(0, OPENGL, ms)
    for _ in range(ROUNDS):
        choice.add(0, CPU, 15.0)
    assert choice.faster(0) == OPENGL


def test_a_submap_that_was_not_timed_is_drawn_as_the_last_one() -> None:
    assert RendererChoice().faster(0) == CPU
    assert timed({CPU: 15.0, OPENGL: 3.0}).faster(1) == OPENGL


def test_renderers_are_compared_at_rest_and_the_faster_takes_over() -> None:
    card = FakeCard()
    made = painter(lambda: card)
    assert not made.compare()  # nothing was asked for yet
    assert made.paint(CAMERA, "rgb", AUTOMATIC, moving=True)[2] == CPU
    assert not made.compare()  # it moves
    made.paint(CAMERA, "rgb", AUTOMATIC, moving=False)
    frames = 0
    while made.compare():
        frames += 1
    assert frames == 2 * ROUNDS and set(card.sizes) == {(40, 30)}
    (remark,) = made.remarks
    assert "OpenGL renders submap 4" in remark.message and "a card of this test" in remark.message
    assert not remark.warning
    submap, pixels, renderer = made.paint(CAMERA, "rgb", AUTOMATIC, moving=True)
    assert (submap, renderer) == (4, OPENGL) and tuple(pixels[0, 0, :3]) == BLUE


def test_a_slow_driver_is_let_go_and_not_tried_on_other_submaps() -> None:
    class Slow(FakeCard):
        def render_bgrx(self, model: SubmapModel, camera: Camera, backdrop: tuple[float, float, float]) -> np.ndarray:
            time.sleep(0.5)
            return super().render_bgrx(model, camera, backdrop)

    card, submap = Slow(), 0
    made = Painter(Models(lambda camera: (submap, MODEL)), lambda: card)
    made.paint(CAMERA, "rgb", AUTOMATIC, moving=False)
    while made.compare():
        pass
    assert "CPU renders submap 0" in made.remarks[0].message and card.left == 0  # released
    submap = 1
    made.paint(CAMERA, "rgb", AUTOMATIC, moving=False)
    assert not made.compare()


@pytest.mark.parametrize(("wanted", "channel", "expected"), [
    (CPU, "rgb", CPU), (OPENGL, "rgb", OPENGL), (OPENGL, "alpha", CPU), (OPENGL, "depth", CPU),
])  # fmt: skip
def test_what_the_person_wants_counts_for_colors(wanted: str, channel: str, expected: str) -> None:
    made = painter(FakeCard)
    assert made.paint(CAMERA, channel, wanted, moving=False)[2] == expected
    assert not made.compare()


def test_without_opengl_the_cpu_draws_and_the_log_says_why_once() -> None:
    made = painter(nowhere)
    for _ in range(2):
        assert made.paint(CAMERA, "rgb", AUTOMATIC, moving=False)[2] == CPU
        assert not made.compare()
    (remark,) = made.remarks
    assert remark.message.startswith("The CPU renders: OpenGL 3.3 cannot be used here") and not remark.warning


def test_who_insists_on_opengl_is_warned_when_there_is_none() -> None:
    made = painter(nowhere)
    assert made.paint(CAMERA, "rgb", OPENGL, moving=False)[2] == CPU
    assert made.remarks[0].warning


def test_a_driver_that_fails_later_costs_no_picture() -> None:
    made = painter(lambda: FakeCard(fails=1))
    assert made.paint(CAMERA, "rgb", OPENGL, moving=True)[2] == OPENGL
    _, pixels, renderer = made.paint(CAMERA, "rgb", OPENGL, moving=True)
    assert renderer == CPU and pixels[..., :3].std() > 5
    (remark,) = made.remarks
    assert remark.warning and "the driver was reset" in remark.message and "Traceback" in remark.trace


def test_splats_without_background_lie_over_a_neutral_one() -> None:
    bare = SubmapModel(Gaussians.empty(), None, None, FloorSurface.flat(0.0))
    _, pixels, _ = painter(nowhere, bare).paint(CAMERA, "rgb", CPU, moving=False)
    assert pixels[6, 8, 2::-1] == pytest.approx(np.array(NEUTRAL) * 255, abs=1)


def test_remarks_of_the_process_reach_the_window(qtbot: QtBot, tmp_path: Path) -> None:
    """A real process: at rest it compares the renderers, or says that it cannot."""
    project = demo_project.write_project(tmp_path / "demo.nvsim", count=400, models=1)
    link = RenderLink()
    remarks: list[LogRemark] = []
    link.remarked.connect(remarks.append)
    try:
        link.open(ProjectSource(project))
        with qtbot.waitSignal(link.arrived, timeout=60_000) as heard:
            link.ask(Request(1, CAMERA, "rgb", False))
        assert heard.args[0].renderer == CPU
        qtbot.waitUntil(lambda: bool(remarks), timeout=60_000)
        assert "renders" in remarks[0].message and not remarks[0].warning, remarks[0]
    finally:
        link.close()


def test_a_remark_goes_to_the_log_and_a_warning_is_shown(window: MainWindow) -> None:
    window.scene.link.remarked.emit(LogRemark("The CPU draws: 3 ms."))
    assert "The CPU draws: 3 ms." in window.panels["log"].toPlainText() and not window.notice_area.texts
    window.scene.link.remarked.emit(LogRemark("OpenGL failed.", "trace", warning=True))
    assert window.notice_area.texts == ["OpenGL failed."]


def test_the_choice_of_the_person_is_remembered(
    make_window: Callable[[Document], MainWindow], document: Document, settings: QSettings
) -> None:
    first = make_window(document)
    assert first.scene.feed.renderer == AUTOMATIC and first.actions_table[f"renderer_{AUTOMATIC}"].isChecked()
    first.actions_table[f"renderer_{OPENGL}"].trigger()
    assert first.scene.feed.renderer == OPENGL
    again = make_window(document)
    assert again.scene.feed.renderer == OPENGL and again.actions_table[f"renderer_{OPENGL}"].isChecked()
    settings.setValue("renderer", "nonsense")
    assert make_window(document).scene.feed.renderer == AUTOMATIC
