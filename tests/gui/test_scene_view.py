"""The 3D view, driven as a hand would drive it."""

from __future__ import annotations

import math

import demo_room
import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, QRect, Qt
from PySide6.QtGui import QColor, QMouseEvent, QWheelEvent
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from nvsim_app.look import colors
from nvsim_app.painting.cameras import ViewPose, overview, seen_from_frame
from nvsim_app.state.document import Document
from nvsim_app.state.free_floor import trajectory_on_floor
from nvsim_app.state.loading import Contents
from nvsim_app.views.scene_view import SceneView
from nvsim_app.wiring.window import MainWindow

PATIENCE = 240_000  # milliseconds until an expected event counts as missing, also on a busy machine
pytestmark = pytest.mark.timeout(1800)


@pytest.fixture
def view(window: MainWindow, document: Document) -> SceneView:
    """Over the room, without a reconstruction: what it draws comes from the document alone."""
    window.scene.navigation.set_pose(overview(document.extent))
    return window.scene


def pixel_of(view: SceneView, point: np.ndarray) -> QPoint:
    pixels, _ = view.overlay_camera.project(point)
    return QPoint(round(pixels[0]), round(pixels[1]))


def drag(view: SceneView, qtbot: QtBot, start: QPoint, step: QPoint, button: Qt.MouseButton, modifier=None) -> None:
    modifiers = modifier or Qt.KeyboardModifier.NoModifier
    qtbot.mousePress(view, button, modifiers, start)
    for i in range(1, 6):
        place = QPointF(start + step * i / 5)
        event = QMouseEvent(
            QMouseEvent.Type.MouseMove, place, view.mapToGlobal(place), Qt.MouseButton.NoButton, button, modifiers
        )
        QApplication.sendEvent(view, event)
    qtbot.mouseRelease(view, button, modifiers, start + step)


def test_a_click_on_a_viewpoint_selects_it(view: SceneView, document: Document, qtbot: QtBot) -> None:
    arrays = document.graph_arrays
    qtbot.mouseClick(view, Qt.MouseButton.LeftButton, pos=pixel_of(view, arrays.feet[5]))
    assert document.selection.viewpoint == arrays.ids[5]


def test_a_click_beside_everything_selects_nothing(view: SceneView, document: Document, qtbot: QtBot) -> None:
    document.select(frame=3)
    qtbot.mouseClick(view, Qt.MouseButton.LeftButton, pos=QPoint(5, 5))
    assert not document.selection


def test_a_double_click_on_the_walk_stands_where_the_frame_was_taken(
    view: SceneView, document: Document, qtbot: QtBot
) -> None:
    view.overlays.set_shown("graph", False)
    place = pixel_of(view, trajectory_on_floor(document)[60])
    qtbot.mouseDClick(view, Qt.MouseButton.LeftButton, pos=place)
    chosen = document.selection.frame
    assert chosen is not None and abs(chosen - 60) <= 3
    goal = seen_from_frame(document.contents.capture.frames[chosen].camera)
    qtbot.waitUntil(lambda: view.pose == goal, timeout=PATIENCE)


def test_a_left_drag_orbits_and_does_not_select(view: SceneView, document: Document, qtbot: QtBot) -> None:
    before = view.pose
    drag(view, qtbot, pixel_of(view, document.graph_arrays.feet[5]), QPoint(60, 20), Qt.MouseButton.LeftButton)
    assert np.allclose(view.pose.pivot, before.pivot, atol=1e-6) and view.pose.position != before.position
    assert not document.selection


def test_a_right_drag_looks_around_in_place(view: SceneView, qtbot: QtBot) -> None:
    before = view.pose
    drag(view, qtbot, QPoint(200, 200), QPoint(50, 0), Qt.MouseButton.RightButton)
    assert view.pose.position == before.position and view.pose.heading > before.heading


def test_shift_and_a_left_drag_pans(view: SceneView, qtbot: QtBot) -> None:
    before = view.pose
    drag(view, qtbot, QPoint(200, 200), QPoint(50, 10), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.ShiftModifier)
    assert (view.pose.heading, view.pose.elevation) == (before.heading, before.elevation)
    assert view.pose.position != before.position


def test_the_wheel_comes_nearer(view: SceneView) -> None:
    before = view.pose.reach
    place = QPointF(view.rect().center())
    event = QWheelEvent(
        place, view.mapToGlobal(place), QPoint(), QPoint(0, 120), Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    QApplication.sendEvent(view, event)
    assert view.pose.reach == pytest.approx(0.85 * before)


def test_w_flies_forward_until_it_is_released(view: SceneView, qtbot: QtBot) -> None:
    view.navigation.set_pose(ViewPose((7, 2, 1.5)))
    qtbot.keyPress(view, Qt.Key.Key_W)
    qtbot.waitUntil(lambda: view.pose.position[1] > 2.2, timeout=PATIENCE)
    qtbot.keyRelease(view, Qt.Key.Key_W)
    qtbot.waitUntil(lambda: not view.navigation.active, timeout=PATIENCE)
    x, _, z = view.pose.position
    assert (x, z) == (pytest.approx(7), pytest.approx(1.5))


def test_losing_the_focus_stops_the_flight(view: SceneView, window: MainWindow, qtbot: QtBot) -> None:
    qtbot.keyPress(view, Qt.Key.Key_D)
    view.navigation.release_all()
    qtbot.waitUntil(lambda: not view.navigation.active, timeout=PATIENCE)


def test_viewpoints_are_painted_where_they_project(view: SceneView, document: Document) -> None:
    for name in ("labels", "trajectory"):
        view.overlays.set_shown(name, False)
    picture = view.grab().toImage()
    for row in (0, 7, 20):
        place = pixel_of(view, document.graph_arrays.feet[row])
        assert picture.pixelColor(place) == QColor(colors.NODE)


def test_hidden_layers_leave_no_pixel(view: SceneView, document: Document) -> None:
    for name in ("graph", "trajectory"):
        view.overlays.set_shown(name, False)
    picture = view.grab().toImage()
    place = pixel_of(view, document.graph_arrays.feet[7])
    assert picture.pixelColor(place) != QColor(colors.NODE)


def test_the_sharp_picture_follows_the_moving_ones(view: SceneView, document: Document, qtbot: QtBot) -> None:
    view.feed.show(demo_room.RoomSource(burn=0.08))
    qtbot.waitUntil(lambda: view.picture is not None and not view.picture.request.moving, timeout=PATIENCE)
    moving = []
    view.pictureShown.connect(lambda p: moving.append(p.request.moving))
    heading = 0.0

    def turned() -> bool:
        nonlocal heading
        heading += 0.02
        view.navigation.set_pose(ViewPose((7, 4.5, 1.5), heading))
        return True in moving

    qtbot.waitUntil(turned, timeout=PATIENCE)
    qtbot.waitUntil(lambda: bool(moving) and not moving[-1] and not view.drawing, timeout=PATIENCE)
    size = view.picture.request.camera.intrinsics
    ratio = view.devicePixelRatioF()
    assert (size.width, size.height) == (round(view.width() * ratio), round(view.height() * ratio))
    assert np.allclose(view.picture.request.camera.position, (7, 4.5, 1.5))


def test_overlays_stay_with_the_picture_beneath_them(view: SceneView, document: Document, qtbot: QtBot) -> None:
    view.feed.show(demo_room.RoomSource())
    qtbot.waitUntil(lambda: view.picture is not None, timeout=PATIENCE)
    shown = view.picture.request.camera.position.copy()
    view.navigation.set_pose(ViewPose((3, 3, 3)))
    assert np.allclose(view.overlay_camera.position, shown)  # the new picture is not there yet


def test_home_is_the_first_frame_once_there_is_a_reconstruction(
    view: SceneView, document: Document, qtbot: QtBot
) -> None:
    view.places.home()
    first = document.contents.capture.frames[0].camera
    qtbot.waitUntil(lambda: np.allclose(view.pose.position, first.position), timeout=PATIENCE)


def test_another_project_places_the_camera_anew(view: SceneView, document: Document, qtbot: QtBot) -> None:
    from pathlib import Path

    view.navigation.set_pose(ViewPose((100, 100, 100)))
    document.set_contents(Contents(Path("other.nvsim")))
    document.set_contents(demo_room.contents(Path("other.nvsim"), scene=False))
    assert math.dist(view.pose.position, (7, 4.5, 1.5)) < 40


def test_the_last_image_stays_while_models_that_were_trained_again_are_loaded(view: SceneView, qtbot: QtBot) -> None:
    source = demo_room.RoomSource()
    view.feed.show(source)
    qtbot.waitUntil(lambda: view.picture is not None and not view.drawing, timeout=PATIENCE)
    before = view.picture
    view.feed.show(demo_room.RoomSource())
    assert view.picture is before and view.feed.note, "nothing goes blank, and it says what it waits for"
    qtbot.waitUntil(lambda: view.picture is not before and not view.drawing, timeout=PATIENCE)
    assert view.picture is not None and not view.feed.note
    view.feed.show(demo_room.RoomSource())
    view.navigation.set_pose(ViewPose((3, 3, 3)))
    assert view.picture is None and np.allclose(view.overlay_camera.position, (3, 3, 3)), "the graph follows the camera"
    view.feed.show(source)
    view.feed.show(None)
    assert view.picture is None
    view.feed.show(demo_room.RoomSource(burn=0.001))
    assert view.picture is None, "another reconstruction"


@pytest.mark.parametrize("key", [Qt.Key.Key_2, Qt.Key.Key_3, Qt.Key.Key_4])
def test_measured_channels_have_a_legend_and_colors_have_none(view: SceneView, qtbot: QtBot, key: Qt.Key) -> None:
    view.navigation.set_pose(ViewPose((7.0, 7.8, 1.5)))  # in front of a bright wall
    view.feed.show(demo_room.RoomSource())
    qtbot.waitUntil(lambda: view.picture is not None and not view.drawing, timeout=PATIENCE)
    corner = QRect(8, 8, 172, 16)

    def legend() -> bool:
        """Whether the dark ground of a legend is at the upper left, over any image."""
        image = view.grab(corner).toImage()
        return max(image.pixelColor(x, 3).lightness() for x in range(140, 166)) < 100

    assert not legend()
    qtbot.keyClick(view, key)
    qtbot.waitUntil(lambda: view.picture.request.channel != "rgb" and not view.drawing, timeout=PATIENCE)
    assert legend()
    qtbot.keyClick(view, Qt.Key.Key_1)
    qtbot.waitUntil(lambda: view.picture.request.channel == "rgb" and not view.drawing, timeout=PATIENCE)
    assert not legend()
