"""The plan, and its ties to the 3D view."""

from __future__ import annotations

from dataclasses import replace

import demo_room
import numpy as np
import pytest
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from nvsim.occupancy.types import OCCUPIED
from nvsim_app.look import colors, theme
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.views.map_view import MapView
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.window import MainWindow


@pytest.fixture
def plan(window: MainWindow) -> MapView:
    window.panels["map"].frame_everything()
    QApplication.processEvents()
    return window.panels["map"]


def place_of(plan: MapView, x: float, y: float):
    scene = plan.plot.getViewBox().mapViewToScene(QPointF(x, y))
    return plan.plot.mapFromScene(scene)


def test_a_click_selects_the_viewpoint_and_the_3d_view_knows(plan: MapView, document: Document, qtbot: QtBot) -> None:
    x, y, _ = document.graph_arrays.positions[6]
    qtbot.mouseClick(plan.plot.viewport(), Qt.MouseButton.LeftButton, pos=place_of(plan, x, y))
    assert document.selection.viewpoint == document.graph_arrays.ids[6]


def test_a_double_click_moves_the_camera_there(plan: MapView, window: MainWindow, qtbot: QtBot) -> None:
    place = place_of(plan, 7.0, 4.0)
    qtbot.mouseClick(plan.plot.viewport(), Qt.MouseButton.LeftButton, pos=place)
    qtbot.mouseDClick(plan.plot.viewport(), Qt.MouseButton.LeftButton, pos=place)
    qtbot.mouseRelease(plan.plot.viewport(), Qt.MouseButton.LeftButton, pos=place)
    qtbot.waitUntil(lambda: np.allclose(window.scene.pose.position[:2], (7, 4), atol=0.15), timeout=20_000)
    assert window.scene.pose.position[2] == pytest.approx(1.5)


def _marker(plan: MapView) -> tuple[float, float]:
    return plan.camera.pos().x(), plan.camera.pos().y()


def test_the_marker_follows_the_3d_camera(plan: MapView, window: MainWindow, qtbot: QtBot) -> None:
    window.scene.navigation.set_pose(ViewPose((3.0, 2.0, 1.5), 1.0))
    qtbot.waitUntil(lambda: _marker(plan) == (3.0, 2.0), timeout=20_000)
    assert plan.camera.isVisible()


def test_of_many_poses_at_once_the_map_shows_the_last(plan: MapView, window: MainWindow, qtbot: QtBot) -> None:
    shown: list[float] = []

    def note() -> None:
        shown.append(plan.camera.pos().x())

    plan.camera.xChanged.connect(note)
    for step in range(200):
        window.scene.navigation.set_pose(ViewPose((1.0 + 0.01 * step, 2.0, 1.5), 1.0))
    qtbot.waitUntil(lambda: shown[-1:] == [pytest.approx(2.99)], timeout=20_000)
    plan.camera.xChanged.disconnect(note)
    assert len(shown) < 100


def test_a_pose_of_the_project_before_does_not_come_late(plan: MapView, window: MainWindow, qtbot: QtBot) -> None:
    for step in range(3):
        window.scene.navigation.set_pose(ViewPose((1.0 + step, 2.0, 1.5), 1.0))
    window.document.set_contents(Contents())
    qtbot.waitUntil(lambda: not plan._pose_soon.isActive(), timeout=20_000)
    assert not plan.camera.isVisible()


def test_dragging_the_marker_moves_the_camera_and_keeps_its_height(plan: MapView, window: MainWindow) -> None:
    window.scene.navigation.set_pose(ViewPose((3.0, 2.0, 1.2), 1.0))
    plan.camera.dragged.emit(5.0, 6.0)
    assert window.scene.pose == ViewPose((5.0, 6.0, 1.2), 1.0)


def test_north_is_up_and_occupancy_lies_under_the_graph(plan: MapView, document: Document) -> None:
    assert place_of(plan, 5, 8).y() < place_of(plan, 5, 2).y()
    document.set_contents(replace(document.contents, graph=None, capture=None, submaps=()))
    QApplication.processEvents()
    picture = plan.plot.grab().toImage()
    ratio = plan.plot.devicePixelRatioF()
    tones = colors.OCCUPANCY_DARK if theme.is_dark(plan.palette()) else colors.OCCUPANCY_LIGHT
    occupancy = document.contents.occupancy
    for x, y in ((4.0, 3.7), (1.0, 6.0), (9.0, 3.0), (-0.5, 4.0)):
        state = occupancy.states_at(np.array([x, y]))
        name = "occupied" if state == OCCUPIED else "free" if state == 0 else "unknown"
        place = place_of(plan, x, y) * ratio
        assert picture.pixelColor(place) == QColor(*tones[name]), (x, y)


def test_a_selected_submap_stands_out(plan: MapView, document: Document) -> None:
    document.select(submap=1)
    widths = {owner: item.opts["pen"].widthF() for owner, item in plan._walks.items()}
    assert widths[1] > max(w for owner, w in widths.items() if owner != 1)


def test_the_whole_map_comes_into_view_by_a_command_and_a_button(window: MainWindow, document: Document) -> None:
    view = window.part(MapPart).view
    view.restore_range(3.0, 3.0, 2.0, 2.0)
    assert view.visible_range is not None and view.visible_range[2] < 9
    window.actions_table["whole_map"].trigger()
    x, y, width, height = view.visible_range
    assert x <= 0.0 and y <= 0.0 and x + width >= demo_room.WIDTH and y + height >= demo_room.DEPTH
    view.restore_range(3.0, 3.0, 2.0, 2.0)
    view.frame.whole.click()
    assert view.visible_range[2] >= demo_room.WIDTH


def test_the_scale_bar_fits_from_the_first_moment(window: MainWindow, qtbot: QtBot) -> None:
    view = window.part(MapPart).view
    view.frame_everything()  # of no size yet
    window.resize(1900, 1060)
    window.show()
    for tall in (False, True, False):
        window.actions_table["workspace_edit" if tall else "workspace_explore"].trigger()
        view.frame_everything()
        qtbot.wait(60)
        assert 15 < view._scale.bar.rect().width() <= 111


def test_the_scale_bar_fits_and_the_place_under_the_cursor_is_told(window: MainWindow, qtbot: QtBot) -> None:
    view = window.part(MapPart).view
    sizes = []
    for meters in (2.0, 20.0, 200.0):
        view.restore_range(0.0, 0.0, meters, meters)
        view._scale.updateBar()
        sizes.append(view._scale.size)
        assert 15 < view._scale.size / view.plot.getViewBox().viewPixelSize()[0] <= 110
    assert sizes == sorted(set(sizes))
    view.restore_range(0.0, 0.0, 14.0, 9.0)
    point = view.to_pixels(np.array([[3.0, 2.0]]))[0]
    qtbot.mouseMove(view.canvas, QPointF(*point).toPoint())
    qtbot.waitUntil(lambda: not view.frame.coordinates.isHidden(), timeout=3000)
    x, y = (float(word) for word in view.frame.coordinates.text().removesuffix(" m").split(", "))
    assert np.hypot(x - 3.0, y - 2.0) < 0.2


@pytest.mark.parametrize("size", [(360, 300), (300, 480), (800, 260), (380, 480), (450, 240)])
def test_nothing_is_under_the_north_arrow_and_the_scale_in_any_size(
    document: Document, qtbot: QtBot, size: tuple[int, int]
) -> None:
    view = MapView(document)
    qtbot.addWidget(view)
    view.show()
    view.frame_everything()
    for width, height in ((420, 420), size):
        view.resize(width, height)
        QApplication.processEvents()
        places = view.to_pixels(view._document.extent[:, :2])
        assert (places > 0).all() and (places < (width, height)).all()
        scale = view._scale.sceneBoundingRect().toAlignedRect()
        for corner in (view.frame.north.geometry(), view.frame.whole.geometry(), scale):
            assert not any(corner.contains(QPointF(*place).toPoint()) for place in places)
        across, along = places.max(axis=0) - places.min(axis=0)
        assert across > 0.6 * width or along > 0.6 * (height - 72)
