"""The layers over the 3D view and their panel."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import demo_room
import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, QRectF, QSettings, Qt
from PySide6.QtGui import QColor, QImage, QPainter
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera
from nvsim_app.layers import labels
from nvsim_app.layers.capture import draw_dots, frustum
from nvsim_app.layers.floor import floor_places
from nvsim_app.layers.layer import Layer
from nvsim_app.look.notices import Notices
from nvsim_app.painting.cameras import ViewPose, overview
from nvsim_app.painting.dots import Dots
from nvsim_app.painting.primitives import paint_label
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.views.overlays import Overlays
from nvsim_app.wiring.window import MainWindow


class Flood(Layer):
    """Fills everything with one color."""

    name, title = "flood", "Flood"

    def paint(self, painter: QPainter, camera: Camera) -> None:
        k = camera.intrinsics
        painter.fillRect(0, 0, k.width, k.height, QColor(200, 0, 0))


def painted(overlays: Overlays, camera: Camera) -> QImage:
    k = camera.intrinsics
    image = QImage(k.width, k.height, QImage.Format.Format_RGB32)
    image.fill(QColor(0, 0, 0))
    painter = QPainter(image)
    overlays.paint(painter, camera)
    painter.end()
    return image


@pytest.fixture
def overlays(document: Document) -> Overlays:
    return Overlays(document)


@pytest.fixture
def camera(document: Document) -> Camera:
    return overview(document.extent).camera(400, 300)


def test_a_layer_of_a_part_is_painted_and_fades(overlays: Overlays, camera: Camera) -> None:
    overlays.add(Flood())
    assert painted(overlays, camera).pixelColor(2, 2) == QColor(200, 0, 0)
    overlays.set_opacity("flood", 0.5)
    assert painted(overlays, camera).pixelColor(2, 2).red() == pytest.approx(100, abs=2)
    overlays.set_shown("flood", False)
    assert painted(overlays, camera).pixelColor(2, 2) == QColor(0, 0, 0)
    overlays.set_shown("flood", True)
    overlays.remove("flood")
    assert painted(overlays, camera).pixelColor(2, 2) == QColor(0, 0, 0)


def test_a_layer_may_lie_below_another(overlays: Overlays) -> None:
    overlays.add(Flood(), below="graph")
    names = [layer.name for layer in overlays.layers]
    assert names.index("flood") + 1 == names.index("graph")
    with pytest.raises(ValueError, match="flood"):
        overlays.add(Flood())


def test_what_is_remembered_counts_for_layers_that_come_later(overlays: Overlays) -> None:
    overlays.remember({"flood": (False, 0.25), "graph": (False, 1.0)})
    overlays.add(Flood())
    assert not overlays["flood"].shown and overlays["flood"].opacity == 0.25
    assert not overlays["graph"].shown
    assert overlays.state["flood"] == (False, 0.25)


def test_every_layer_paints_and_says_when_it_has_nothing(overlays: Overlays, document: Document) -> None:
    camera = ViewPose((7.0, 0.5, 2.5), elevation=-0.5).camera(400, 300)
    capture = document.contents.capture
    cloud = Cloud(np.random.default_rng(0).uniform(0, 9, (500, 3)).astype(np.float32), None, "lidar")
    document.set_contents(replace(document.contents, capture=replace(capture, cloud=cloud)))
    document.select(frame=30)
    empty = Overlays(Document())
    overlays.grid.bare = True
    for layer in overlays.layers:
        for other in overlays.layers:
            other.shown = other is layer or (layer.name == "labels" and other.name == "graph")
        shown = painted(overlays, camera)
        layer.shown = False
        assert painted(overlays, camera) != shown, layer.name
        assert layer.missing == "", layer.name
        if layer.name != "grid":
            assert empty[layer.name].missing, layer.name


def test_names_of_viewpoints_do_not_lie_on_each_other(
    overlays: Overlays, document: Document, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[tuple[str, QRectF]] = []

    def noted(painter: QPainter, anchor: QPointF, text: str, ink: QColor, fill: QColor) -> QRectF:
        drawn.append((text, paint_label(painter, anchor, text, ink, fill)))
        return drawn[-1][1]

    monkeypatch.setattr(labels, "paint_label", noted)
    view = ViewPose((7.0, 0.5, 1.4), elevation=-0.1).camera(160, 120)
    seen = overlays.graph.projected_viewpoints(view)
    farthest = document.graph_arrays.ids[next(r for r in seen.order if seen.depths[r] < labels.LABEL_DISTANCE)]
    document.select(viewpoint=farthest)
    painted(overlays, view)
    assert drawn[0][0] == labels.short_id(document.graph, farthest)
    assert 1 < len(drawn) < (seen.depths[seen.order] < labels.LABEL_DISTANCE).sum()
    boxes = [box for _, box in drawn]
    assert not any(a.intersects(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_the_frustum_holds_the_picture_of_its_frame(document: Document) -> None:
    frame = document.contents.capture.frames[7]
    starts, ends = frustum(frame, 0.5)
    pixels, depths = frame.camera.project(ends[:4])
    k = frame.intrinsics
    assert np.allclose(depths, 0.5)
    assert np.allclose(pixels, [(0, 0), (k.width, 0), (k.width, k.height), (0, k.height)], atol=1e-6)
    assert np.allclose(starts[:4], frame.camera.position)


def test_rays_meet_the_floor_where_the_floor_projects(camera: Camera) -> None:
    places = floor_places(camera, 0.0)
    row, column = 200, 150
    point = np.array([*places[row, column], 0.0])
    pixel, _ = camera.project(point)
    assert np.allclose(pixel, (column + 0.5, row + 0.5), atol=0.05)


def test_rays_above_the_horizon_meet_no_floor() -> None:
    places = floor_places(ViewPose((0, 0, 1.5)).camera(40, 30), 0.0)
    assert np.isnan(places[:15]).all() and np.isfinite(places[20:]).all()


def test_near_dots_lie_over_far_ones() -> None:
    camera = ViewPose((0, 0, 1.5)).camera(80, 60)
    image = np.zeros((60, 80), np.uint32)
    points = np.array([(0, 2, 1.5), (0, 8, 1.5)], np.float32)
    draw_dots(image, camera, points, np.array([7, 9], np.uint32))
    assert image[30, 40] == 7 and np.count_nonzero(image == 7) == 9


def test_a_large_cloud_is_thinned_evenly() -> None:
    points = np.zeros((200_000, 3), np.float32)
    points[:, 0] = np.arange(200_000)
    some = Dots.of(Cloud(points, None, "lidar")).points
    assert len(some) == 60_000
    counts, _ = np.histogram(some[:, 0], bins=10, range=(0, 200_000))
    assert counts.min() > 5500 and counts.max() < 6500


def test_the_panel_and_the_switches_and_the_layers_agree(window: MainWindow, qtbot: QtBot) -> None:
    panel, overlays = window.panels["layers"], window.scene.overlays
    panel.boxes["graph"].click()
    assert not overlays["graph"].shown and not window.actions_table["show_graph"].isChecked()
    window.actions_table["show_graph"].trigger()
    assert overlays["graph"].shown and panel.boxes["graph"].isChecked()
    panel.sliders["trajectory"].setValue(40)
    assert overlays["trajectory"].opacity == 0.4
    overlays.add(Flood())
    assert panel.boxes["flood"].isChecked()


def test_a_box_says_why_its_layer_draws_nothing(window: MainWindow) -> None:
    assert "no point cloud" in window.panels["layers"].boxes["cloud"].toolTip()


def test_layers_come_back_with_the_next_window(
    make_window: Callable[[Document], MainWindow], document: Document, settings: QSettings, qtbot: QtBot
) -> None:
    first = make_window(document)
    first.scene.overlays.set_shown("trajectory", False)
    first.scene.overlays.set_opacity("graph", 0.3)
    first.close()
    settings.setValue("layers/labels", "nonsense")
    settings.setValue("layers/cloud", "off nan")
    second = MainWindow(document, settings, Notices())
    qtbot.addWidget(second)
    assert not second.scene.overlays["trajectory"].shown
    assert second.scene.overlays["graph"].opacity == pytest.approx(0.3)
    assert second.scene.overlays["labels"].shown
    assert 0 <= second.scene.overlays["cloud"].opacity <= 1
    assert not second.actions_table["show_trajectory"].isChecked()
    second.close()


def test_hidden_layers_are_not_picked(window: MainWindow, document: Document, qtbot: QtBot) -> None:
    view = window.scene
    view.navigation.set_pose(overview(document.extent))
    pixels, _ = view.overlay_camera.project(document.graph_arrays.feet[5])
    view.overlays.set_shown("graph", False)
    view.overlays.set_shown("trajectory", False)
    qtbot.mouseClick(view, Qt.MouseButton.LeftButton, pos=QPointF(*pixels).toPoint())
    assert not document.selection


def _imported(cloud: bool) -> Contents:
    """The demo room after an import: frames with poses, and a point cloud if `cloud`."""
    points = np.random.default_rng(0).uniform((0, 0, 0), (14, 9, 2.8), (4000, 3)).astype(np.float32)
    scan = Cloud(points, np.full((4000, 3), 200, np.uint8)) if cloud else None
    capture = replace(demo_room.capture(), cloud=scan)
    return Contents(Path("new.nvsim"), capture, stages=frozenset({"import"}))


@pytest.mark.parametrize(("cloud", "name"), [(True, "cloud"), (False, "frusta")])
def test_views_show_an_import_until_there_is_a_reconstruction(
    make_window: Callable[[Document], MainWindow], settings: QSettings, cloud: bool, name: str
) -> None:
    document = Document()
    window = make_window(document)
    document.set_contents(_imported(cloud))
    overlays = window.scene.overlays
    assert overlays[name].shown and window.panels["layers"].boxes[name].isChecked()
    image = window.scene.grab().toImage()
    overlays.set_shown(name, False)
    assert image != window.scene.grab().toImage()  # the layer is visible from the first camera
    overlays.set_shown(name, True)
    document.set_contents(demo_room.contents(Path("new.nvsim")))
    assert not overlays[name].shown


def test_an_import_stays_hidden_after_the_user_hides_it(window_of_import: MainWindow) -> None:
    box = window_of_import.panels["layers"].boxes["frusta"]
    QTest.mouseClick(box, Qt.MouseButton.LeftButton, pos=QPoint(8, box.height() // 2))
    document = window_of_import.document
    document.set_contents(replace(document.contents, submaps=demo_room.submaps(demo_room.capture())))
    assert not window_of_import.scene.overlays["frusta"].shown


@pytest.fixture
def window_of_import(make_window: Callable[[Document], MainWindow]) -> MainWindow:
    document = Document()
    document.set_contents(_imported(cloud=False))
    return make_window(document)


@pytest.mark.parametrize(("cloud", "name"), [(True, "cloud"), (False, "frusta")])
def test_a_layer_releases_the_project_that_is_left(
    make_window: Callable[[Document], MainWindow], cloud: bool, name: str
) -> None:
    document = Document()
    document.set_contents(_imported(cloud))
    window = make_window(document)
    window.scene.grab()
    capture = document.contents.capture
    assert capture is not None and window.scene.overlays[name].shown
    held = weakref.ref(capture.cloud if cloud else capture)
    del capture
    document.projectLeft.emit()
    document.set_contents(Contents())
    QApplication.processEvents()
    gc.unfreeze()
    gc.collect()
    assert held() is None
