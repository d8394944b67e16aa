"""Keys and gestures that users know from other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from editing_room import Hand
from PySide6.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
from PySide6.QtGui import QDragEnterEvent, QDragLeaveEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from nvsim.graph.selection import GraphSelection
from nvsim.occupancy.types import FREE
from nvsim_app.drawing.cutaway import OUTSIDE
from nvsim_app.painting.cameras import ViewPose, overview
from nvsim_app.state.document import Document
from nvsim_app.wiring.appearance import PalettePart
from nvsim_app.wiring.new_project import NewProjectPart
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.window import MainWindow


@pytest.fixture
def ready(window: MainWindow) -> MainWindow:
    window.activateWindow()
    window.scene.setFocus()
    QApplication.processEvents()
    return window


def test_f_shows_the_selection_or_else_everything(ready: MainWindow, document: Document) -> None:
    plan, arrays = ready.part(MapPart).view, document.graph_arrays
    document.editing.select(GraphSelection(frozenset(arrays.ids[:1])))
    QTest.keyClick(ready.scene, Qt.Key.Key_F)
    goal = ready.scene.navigation.goal
    assert np.linalg.norm(np.cross(goal.axes[:, 2], arrays.feet[0] + [0, 0, 0.6] - goal.position)) < 1e-6
    shown = plan.plot.getViewBox().viewRect()
    assert np.allclose((shown.center().x(), shown.center().y()), arrays.feet[0, :2], atol=0.1)
    document.editing.select(GraphSelection())
    document.select()
    QTest.keyClick(ready.scene, Qt.Key.Key_F)
    assert ready.scene.navigation.goal == overview(document.extent)
    shown = plan.plot.getViewBox().viewRect()
    assert all(shown.contains(QPointF(x, y)) for x, y in document.extent[:, :2])


def test_a_double_click_in_the_3d_view_centers_the_floor_under_it(ready: MainWindow, document: Document) -> None:
    scene = ready.scene
    scene.navigation.set_pose(overview(document.extent))
    surface = next(canvas.surface for canvas in ready.modes.canvases if canvas.surface.widget is scene)
    hand = Hand(ready, surface)
    spots = (QPoint(x, y) for y in range(scene.height() // 2, scene.height(), 9) for x in range(9, scene.width(), 9))
    pixel = next(
        spot for spot in spots
        if not (surface.pick_viewpoint(QPointF(spot)) or surface.pick_frame(QPointF(spot)) is not None)
        and surface.floor_point(QPointF(spot)) is not None
    )  # fmt: skip
    floor = np.array(hand.surface.floor_point(QPointF(pixel)))
    QTest.mouseDClick(scene, Qt.MouseButton.LeftButton, pos=pixel)
    goal = scene.navigation.goal
    assert np.allclose(goal.position + goal.reach * goal.axes[:, 2], floor, atol=1e-6)
    assert goal.reach <= 3.0 and floor[2] + 0.5 < goal.position[2] < floor[2] + 2.0


def test_a_point_beside_an_outer_wall_is_centered_from_inside(ready: MainWindow, document: Document) -> None:
    scene, occupancy = ready.scene, document.contents.occupancy
    assert occupancy is not None
    scene.navigation.set_pose(overview(document.extent))
    hand = Hand(ready, next(canvas.surface for canvas in ready.modes.canvases if canvas.surface.widget is scene))
    spot = np.array([2.2, 1.6, 0.0])  # the overview looks over this wall
    pixel = hand.pixel(spot)
    assert hand.surface.pick_viewpoint(QPointF(pixel)) is None
    QTest.mouseDClick(scene, Qt.MouseButton.LeftButton, pos=pixel)
    goal = scene.navigation.goal
    assert np.allclose(goal.pivot, spot, atol=0.1) and goal.reach >= 0.8
    assert occupancy.states_at(np.array(goal.position[:2])) == FREE


def test_no_wall_hides_a_viewpoint_that_f_frames(ready: MainWindow, document: Document) -> None:
    arrays, occupancy = document.graph_arrays, document.contents.occupancy
    assert occupancy is not None
    for start in (overview(document.extent), ViewPose((2.0, 2.0, 1.5), 0.5)):
        for row in range(0, len(arrays.ids), 2):
            ready.scene.navigation.set_pose(start)
            document.editing.select(GraphSelection(frozenset([arrays.ids[row]])))
            QTest.keyClick(ready.scene, Qt.Key.Key_F)
            goal = ready.scene.navigation.goal
            line = np.linspace(goal.position, arrays.feet[row] + [0, 0, 0.6], 100)
            assert (occupancy.states_at(line[:, :2]) == FREE).all(), arrays.ids[row]
            assert 1.0 < goal.position[2] < 2.0, "below the ceiling, and not on the floor"


def test_f_shows_several_viewpoints_over_the_walls(ready: MainWindow, document: Document) -> None:
    ready.scene.navigation.set_pose(ViewPose((2.0, 2.0, 1.5)))
    document.editing.select(GraphSelection(frozenset(document.graph_arrays.ids[:5])))
    QTest.keyClick(ready.scene, Qt.Key.Key_F)
    assert ready.scene.navigation.goal.position[2] > OUTSIDE


def test_a_dragged_file_highlights_the_window(ready: MainWindow, tmp_path: Path, qtbot: QtBot) -> None:
    target = ready.part(NewProjectPart).target
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(tmp_path / "room.ply"))])
    actions, buttons = Qt.DropAction.CopyAction, Qt.MouseButton.LeftButton
    event = QDragEnterEvent(QPoint(50, 50), actions, data, buttons, Qt.KeyboardModifier.NoModifier)
    QApplication.sendEvent(ready, event)
    assert event.isAccepted() and target.isVisible() and target.size() == ready.size()
    assert target.words == "Drop room.ply to open or import it"
    ready.grab()
    QApplication.sendEvent(ready, QDragLeaveEvent())
    assert not target.isVisible()


def test_ctrl_shift_p_finds_panels_and_layers(ready: MainWindow, qtbot: QtBot) -> None:
    ready.docks["log"].hide()
    QTest.keyClick(ready, Qt.Key.Key_P, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier)
    popup = ready.part(PalettePart).view
    qtbot.waitUntil(popup.isVisible)
    QTest.keyClicks(popup.line, "panel log")
    QTest.keyClick(popup.line, Qt.Key.Key_Return)
    assert not popup.isVisible() and not ready.docks["log"].isHidden()
    shown = ready.scene.overlays["trajectory"].shown
    QTest.keyClick(ready, Qt.Key.Key_P, Qt.KeyboardModifier.ControlModifier)
    QTest.keyClicks(popup.line, "layer trajectory")
    QTest.keyClick(popup.line, Qt.Key.Key_Return)
    assert ready.scene.overlays["trajectory"].shown != shown
