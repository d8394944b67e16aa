"""The inspector: regions are drawn at the position of their evidence, texts name the decisive criterion, and all views
share the hovered edge."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import demo_room
import numpy as np
import pytest
from painted_layers import pixels_on_map
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication, QDockWidget
from pytestqt.qtbot import QtBot

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.mapping.config import MappingConfig
from nvsim_app.drawing.panorama_child import PanoramaDrawing, PanoramaRequest
from nvsim_app.inspector.layers import clip_at_near_plane
from nvsim_app.inspector.panoramas import Panoramas
from nvsim_app.inspector.state import direction_hit, viewing_angles
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.state.directions import directions
from nvsim_app.state.document import Document
from nvsim_app.wiring.inspector import InspectorPart
from nvsim_app.wiring.window import MainWindow
from nvsim_app.wiring.workspace_layouts import WorkspacePart


def part_of(window: MainWindow) -> InspectorPart:
    return window.part(InspectorPart)


@pytest.fixture
def part(window: MainWindow, document: Document) -> InspectorPart:
    document.select(viewpoint=document.graph_arrays.ids[7])
    found = part_of(window)
    found.show_panel()
    QApplication.processEvents()
    return found


def test_a_viewpoint_has_eight_regions_and_those_with_an_edge_name_their_neighbor(document: Document) -> None:
    graph, arrays = document.contents.graph, document.graph_arrays
    assert graph is not None
    for id in arrays.ids[:12]:
        found = directions(graph, arrays, id, MappingConfig())
        assert [d.evidence.direction for d in found] == list(range(8))
        for direction in found:
            assert direction.polygon().shape == (4, 3)
            assert np.allclose(direction.polygon()[:, 2], 0.0, atol=1e-9)
            failed = direction.explanation.failed
            whole = failed is None or failed.criterion.over == "corridor"
            assert (failed is None) == direction.open and (direction.failed_corners() is None) == whole
            goal = np.array(direction.evidence.target)
            if direction.neighbor:
                assert math.dist(goal, arrays.positions[arrays.index[direction.neighbor], :2]) < 0.01


def test_the_sentence_names_the_value_the_limit_and_where_something_stands(document: Document) -> None:
    graph, arrays = document.contents.graph, document.graph_arrays
    assert graph is not None
    blocked = [d for id in arrays.ids for d in directions(graph, arrays, id, MappingConfig()) if not d.open]
    shut = next(d for d in blocked if d.explanation.obstacle is not None and d.explanation.obstacle > 0.5)
    assert shut.sentence.startswith(f"No edge to the {shut.place}: ")
    assert "threshold 0." in shut.sentence and f"obstacle at {shut.explanation.obstacle:.1f} m" in shut.sentence
    paper = MappingConfig.paper()
    free = next(d for d in directions(graph, arrays, arrays.ids[7], paper) if d.joined)
    assert free.sentence.startswith(f"An edge to the {free.place}") and "all thresholds are met" in free.sentence


def test_a_region_is_met_by_looking_at_its_middle_and_not_above_the_horizon(document: Document) -> None:
    graph, arrays = document.contents.graph, document.graph_arrays
    assert graph is not None
    id = arrays.ids[7]
    eye = arrays.positions[7]
    found = directions(graph, arrays, id, MappingConfig())
    for direction in found:
        middle = direction.polygon().mean(axis=0)
        ((heading, elevation),) = viewing_angles(middle[None], eye)
        assert direction_hit(found, eye, heading, elevation) is direction
        assert direction_hit(found, eye, heading, 0.2) is None
        assert direction_hit(found, eye, heading + math.radians(22.5), elevation / 3) is None


def test_a_region_behind_the_eye_is_cut_off_and_never_turned_inside_out() -> None:
    camera = Camera(Intrinsics.from_fov(100, 100, 1.2), camera_pose(np.array([0.0, 0.0, 1.5]), 0.0, -0.4))
    corners = np.array([[-0.3, -2.0, 0.0], [-0.3, 4.0, 0.0], [0.3, 4.0, 0.0], [0.3, -2.0, 0.0]])
    seen = clip_at_near_plane(corners, camera)
    _, depth = camera.project(seen)
    assert len(seen) == 4 and (depth > 0).all()
    assert len(clip_at_near_plane(corners - [0, 9, 0], camera)) == 0
    np.testing.assert_array_equal(clip_at_near_plane(corners + [0, 6, 0], camera), corners + [0, 6, 0])


def test_the_panorama_shows_north_in_the_middle_and_comes_coarse_first() -> None:
    renderer = demo_room.RoomSource().open()
    drawing = PanoramaDrawing(renderer)
    eye = (4.0, 6.0, 1.5)
    drawing.begin(PanoramaRequest("here", eye, (96, 192)))
    made = [p for p in (drawing.step() for _ in range(60)) if p is not None]
    assert [p.width for p in made] == [96, 192] and [p.final for p in made] == [False, True]
    assert not drawing.has_waiting_views and drawing.step() is None
    alpha = made[1].pixels["alpha"][..., 0].astype(float) / 255
    assert alpha.shape == (96, 192)
    for place, expected in (((3.9, 3.7, 0.75), 0.99), ((4.0, 7.5, 0.0), 0.0), ((6.7, 7.0, 1.1), 0.99)):
        ((heading, elevation),) = viewing_angles(np.array([place]), np.array(eye))
        column, row = round((heading / (2 * math.pi) + 0.5) * 192), round((0.5 - elevation / math.pi) * 96)
        assert alpha[row, column % 192] == pytest.approx(expected, abs=0.05), place


def test_the_value_under_the_cursor_is_what_was_measured_there(
    part: InspectorPart, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = part.panel.view
    view.resize(400, 200)
    eye = tuple(part.inspection.eye)
    drawing = PanoramaDrawing(demo_room.RoomSource().open())
    drawing.begin(PanoramaRequest("here", eye, (384,)))
    (made,) = [p for p in (drawing.step() for _ in range(30)) if p is not None]
    monkeypatch.setattr(Panoramas, "current", made)

    def words(channel: str, *place: float) -> str:
        view.set_channel(channel)
        ((x, y),) = view.to_pixels(viewing_angles(np.array([place]), part.inspection.eye))
        at = QPointF(x % (2 * math.pi * view._scale), y)
        button = Qt.MouseButton.NoButton
        event = QMouseEvent(
            QEvent.Type.MouseMove, at, view.mapToGlobal(at), button, button, Qt.KeyboardModifier.NoModifier
        )
        QApplication.sendEvent(view, event)
        view.grab()
        return view.value_words

    ahead = (eye[0], demo_room.DEPTH, eye[2])  # the wall to the north, which faces south
    assert words("alpha", *ahead) == "alpha 0.97" and words("rgb", *ahead) == ""
    assert re.fullmatch(r"normal up -?0\.0[0-2], faces S", words("normal", *ahead))
    under = (eye[0], eye[1] + 0.5, 0.0)
    assert words("alpha", *under) == "alpha 0.00" and words("normal", *under) == "no normal"


def test_a_newer_panorama_takes_the_place_of_one_that_is_not_finished() -> None:
    drawing = PanoramaDrawing(demo_room.RoomSource().open())
    drawing.begin(PanoramaRequest("old", (4.0, 6.0, 1.5), (64,)))
    for _ in range(5):
        assert drawing.step() is None
    drawing.begin(PanoramaRequest("new", (5.0, 6.0, 1.5), (64,)))
    made = [p for p in (drawing.step() for _ in range(40)) if p is not None]
    assert [p.key for p in made] == ["new"]


def test_pointing_in_the_panorama_is_seen_in_the_list_the_values_and_on_the_map(
    part: InspectorPart, qtbot: QtBot
) -> None:
    panel, view = part.panel, part.panel.view
    panel.resize(400, 500)
    view.resize(400, 200)
    direction = next(d for d in part.inspection.directions if d.neighbor)
    middle = direction.polygon().mean(axis=0)
    seen = viewing_angles(middle[None], part.inspection.eye)
    ((x, y),) = view.to_pixels(seen)
    heading, elevation = view.to_angles(QPointF(x, y))
    assert (heading, elevation) == pytest.approx(tuple(seen[0]))
    outlines = pixels_on_map(part.layer, part.context)
    qtbot.mouseMove(view, QPoint(round(x) % view.width(), round(y)))
    QApplication.processEvents()
    assert part.inspection.current is direction
    assert panel.sentence.text() == direction.sentence
    assert panel.list.currentIndex().siblingAtColumn(0).data() == direction.place
    assert pixels_on_map(part.layer, part.context) > outlines > 0
    assert "mean alpha" in panel.bars.accessibleDescription()


def test_a_click_on_a_region_goes_to_the_neighbor(part: InspectorPart, window: MainWindow, qtbot: QtBot) -> None:
    view, document = part.panel.view, window.document
    direction = next(d for d in part.inspection.directions if d.neighbor)
    ((x, y),) = view.to_pixels(viewing_angles(direction.polygon().mean(axis=0)[None], part.inspection.eye))
    place = QPoint(round(x) % view.width(), round(y))
    qtbot.mouseClick(view, Qt.MouseButton.LeftButton, pos=place)
    assert document.selection.viewpoint == direction.neighbor
    assert part.inspection.viewpoint == direction.neighbor


def test_a_drag_turns_the_panorama_and_chooses_nothing(part: InspectorPart, window: MainWindow, qtbot: QtBot) -> None:
    view, before = part.panel.view, window.document.selection
    heading = view.to_angles(QPointF(view.width() / 2, 10))[0]
    qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=QPoint(100, 100))
    qtbot.mouseMove(view, QPoint(160, 100))
    qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=QPoint(160, 100))
    assert view.to_angles(QPointF(view.width() / 2, 10))[0] % (2 * math.pi) != pytest.approx(heading % (2 * math.pi))
    assert window.document.selection == before


def test_the_panorama_arrives_from_the_drawing_process_and_is_kept(
    window: MainWindow, document: Document, qtbot: QtBot
) -> None:
    part = part_of(window)
    document.select(viewpoint=document.graph_arrays.ids[3])
    part.show_panel()
    window.scene.feed.show(demo_room.RoomSource())
    qtbot.waitUntil(lambda: part.panoramas.current is not None and part.panoramas.current.final, timeout=60_000)
    assert not part.panoramas.drawing
    picture = part.panel.view.grab().toImage()
    assert len({picture.pixelColor(x, picture.height() - 20).name() for x in range(0, picture.width(), 7)}) > 5
    kept = part.panoramas.current
    document.select(viewpoint=document.graph_arrays.ids[4])
    document.select(viewpoint=document.graph_arrays.ids[3])
    assert part.panoramas.current is kept
    window.scene.feed.show(None)


def test_nothing_is_drawn_while_nobody_looks(part: InspectorPart, window: MainWindow) -> None:
    assert part.panoramas._wanted is not None
    dock = window.findChild(QDockWidget, "dock_inspector")
    assert dock is not None
    dock.hide()
    QApplication.processEvents()
    assert part.panoramas._wanted is None


def test_other_thresholds_change_the_words_at_once(part: InspectorPart) -> None:
    usual = [d.open for d in part.inspection.directions]
    part.inspection.try_out(replace(MappingConfig(), tau_alpha=0.0))
    assert not any(d.open for d in part.inspection.directions)
    assert "threshold 0.00" in part.inspection.directions[0].sentence
    part.inspection.try_out(None)
    assert [d.open for d in part.inspection.directions] == usual


def test_channel_and_regions_come_back_with_the_next_window(part: InspectorPart, window: MainWindow, qtbot) -> None:
    part.panel.set_channel("alpha")
    part.panel.regions.setChecked(False)
    part.store(window.settings)
    part.panel.set_channel("rgb")
    part.panel.regions.setChecked(True)
    part.restore(window.settings)
    assert part.panel.view.channel == "alpha" and not part.panel.view.shows_regions


def test_regions_are_outlines_over_the_view(part: InspectorPart, window: MainWindow, document: Document) -> None:
    """Inside a region that is not highlighted, every pixel is that of the floor."""
    scene, id = window.scene, document.selection.viewpoint
    x, y, z = map(float, document.graph_arrays.positions[document.graph_arrays.index[id]])
    scene.navigation.set_pose(ViewPose((x, y - 2.0, z + 2.5), 0.0, -0.7))
    scene.overlays.set_shown("graph", False)
    scene.overlays.set_shown("trajectory", False)
    with_regions = scene.grab().toImage()
    scene.overlays.set_shown("rois", False)
    floor = scene.grab().toImage()
    assert with_regions != floor
    inside = [p for d in part.inspection.directions if d.lattice and d.open for p in [d.polygon().mean(axis=0)]]
    pixels, depths = scene.overlay_camera.project(np.array(inside))
    at = [(round(x), round(y)) for (x, y), z in zip(pixels, depths, strict=True) if z > 0.1]
    seen = [(x, y) for x, y in at if 0 <= x < scene.width() and 0 <= y < scene.height()]
    assert seen
    assert all(with_regions.pixelColor(x, y) == floor.pixelColor(x, y) for x, y in seen)


def test_at_720_pixels_the_whole_inspector_is_shown(window: MainWindow, document: Document, qtbot: QtBot) -> None:
    window.resize(1280, 720)
    QApplication.processEvents()
    window.part(WorkspacePart).reset()
    document.select(viewpoint=document.graph_arrays.ids[3])
    QApplication.processEvents()
    part_of(window).show_panel()
    panel = part_of(window).panel
    qtbot.waitUntil(lambda: panel.list.isVisible() and panel.list.height() > 0)
    qtbot.waitUntil(lambda: panel.verticalScrollBar().maximum() == 0)  # the panel does not scroll
    assert panel.list.viewport().height() >= 3 * panel.list.rowHeight(0)
    assert panel.bars.mapTo(panel, panel.bars.rect().bottomLeft()).y() <= panel.height()


def test_directions_are_complete_in_a_narrow_panel(part: InspectorPart, qtbot: QtBot) -> None:
    panel = part.panel
    qtbot.waitUntil(lambda: len(panel.model.rows) == 8)
    for width in (205, 230, 260):
        panel.list.resize(width, 150)
        assert panel.list.columnWidth(0) >= panel.list.sizeHintForColumn(0)


def test_the_texts_of_the_bars_do_not_overlap(window: MainWindow, document: Document, qtbot: QtBot) -> None:
    """Two columns are used only where the texts of both fit."""
    window.resize(1280, 720)
    document.select(viewpoint=document.graph_arrays.ids[3])
    part_of(window).show_panel()
    panel = part_of(window).panel
    bars = panel.bars
    bars.set_most_columns(2)
    qtbot.waitUntil(lambda: panel.model.rowCount() > 1)
    panel.list.setCurrentIndex(panel.model.index(1, 0))
    qtbot.waitUntil(lambda: len(bars._measures) > 1)
    for width in (300, 900):
        bars.resize(width, bars.height())
        assert (bars._columns == 2) == (width == 900)
        names, figures = bars._widths()
        assert bars._columns * (names + figures) < width
