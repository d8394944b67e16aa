"""Walking: the eye stays above the floor wherever the hand takes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import NavGraph
from nvsim.occupancy.types import UNKNOWN
from nvsim_app.painting.cameras import ViewPose, walk_pose
from nvsim_app.state.document import Document
from nvsim_app.state.free_floor import FreeFloor
from nvsim_app.wiring.window import MainWindow


def test_a_step_ahead_follows_the_heading_and_not_the_eyes() -> None:
    down = ViewPose((0, 0, 1.5), heading=pi / 2, elevation=-1.5)
    assert np.allclose(walk_pose(down, 2.0, 0.0).position, (2, 0, 1.5))
    assert np.allclose(walk_pose(down, 0.0, 1.0).position, (0, -1, 1.5))


def walk_from(window: MainWindow, qtbot: QtBot, pose: ViewPose) -> None:
    """Moves to the position and starts to walk."""
    window.scene.navigation.set_pose(pose)
    window.actions_table["walk"].trigger()
    qtbot.waitUntil(lambda: not window.scene.navigation.active, timeout=3000)


def held(window: MainWindow, qtbot: QtBot, key: Qt.Key, done: Callable[[], bool]) -> None:
    qtbot.keyPress(window.scene, key)
    qtbot.waitUntil(done, timeout=5000)
    qtbot.keyRelease(window.scene, key)


def test_walking_brings_the_eye_down_and_keeps_it_there(window: MainWindow, qtbot: QtBot) -> None:
    view = window.scene
    walk_from(window, qtbot, ViewPose((7, 2, 2.2), elevation=-0.4))
    assert view.pose.position == pytest.approx((7, 2, 1.5)) and view.pose.elevation == -0.4
    held(window, qtbot, Qt.Key.Key_W, lambda: view.pose.position[1] > 2.4)
    assert view.pose.position[2] == pytest.approx(1.5) and view.pose.elevation == -0.4
    window.actions_table["walk"].trigger()
    held(window, qtbot, Qt.Key.Key_E, lambda: view.pose.position[2] > 1.7)


def test_from_above_a_walk_begins_where_somebody_stood_near_what_one_looks_at(
    window: MainWindow, document: Document, qtbot: QtBot
) -> None:
    view = window.scene
    walk_from(window, qtbot, ViewPose((7.0, -6.0, 9.0), elevation=-0.7))
    x, y, z = view.pose.position
    known = np.concatenate([document.graph_arrays.positions, document.trajectory.positions])
    assert np.hypot(known[:, 0] - x, known[:, 1] - y).min() < 1e-6
    assert z == pytest.approx(1.5) and view.pose.elevation == 0.0
    assert np.hypot(x - 7.0, y - (-6.0 + 9.0 / np.tan(0.7))) < 2.0


def test_walls_and_furniture_stop_a_walk_and_one_slides_along_them(window: MainWindow, qtbot: QtBot) -> None:
    view = window.scene
    walk_from(window, qtbot, ViewPose((7.8, 3.0, 1.5), heading=pi / 2))
    assert view.places.walk_limits.free(7.8, 3.0, 1.5) and not view.places.walk_limits.free(8.8, 3.0, 1.5)
    held(window, qtbot, Qt.Key.Key_W, lambda: view.pose.position[0] > 8.3)
    qtbot.keyPress(view, Qt.Key.Key_W)
    qtbot.wait(400)
    qtbot.keyRelease(view, Qt.Key.Key_W)
    assert view.pose.position[0] < 8.5, "the shelf begins at 8.6"
    view.navigation.walk(view.places.walk_limits, replace(view.pose, heading=pi / 4))
    held(window, qtbot, Qt.Key.Key_W, lambda: view.pose.position[1] > 4.0)
    assert view.pose.position[0] < 8.5


@pytest.mark.parametrize("command", ["home", "overview", "above", "next_frame"])
def test_any_other_way_of_moving_ends_a_walk(window: MainWindow, qtbot: QtBot, command: str) -> None:
    table = window.actions_table
    walk_from(window, qtbot, ViewPose((7, 2, 1.5)))
    assert table["walk"].isChecked()
    table[command].trigger()
    assert not table["walk"].isChecked() and window.scene.navigation.walking is None


def test_without_a_map_evidence_stops_a_walk_and_without_that_the_places_where_somebody_stood(
    window: MainWindow, document: Document
) -> None:
    document.set_contents(replace(document.contents, occupancy=None))
    free = window.scene.places.walk_limits.free
    assert free(7.8, 3.0, 1.5) and not free(8.9, 3.1, 1.5), "Gaussians of the shelf are in the evidence"
    graph = document.contents.graph
    document.set_contents(replace(document.contents, graph=replace(graph, evidence={})))
    assert free(8.0, 3.0, 1.5) and not free(7.0, -3.0, 1.5)
    assert not FreeFloor(document).free(8.0, 3.0, 9.0), "another storey"


def test_the_floor_under_the_eye_counts_and_not_that_of_the_storey_above(
    window: MainWindow, document: Document
) -> None:
    graph = document.contents.graph
    upper = {
        f"up {id}": replace(v, id=f"up {id}", position=(v.position[0], v.position[1], v.position[2] + 3.2))
        for id, v in graph.viewpoints.items()
    }
    both = NavGraph("two storeys", {**graph.viewpoints, **upper}, graph.edges, {})
    document.set_contents(replace(document.contents, graph=both))
    assert window.scene.places.eye_level(3, 2, 1.4) == pytest.approx(1.5)
    assert window.scene.places.eye_level(3, 2, 4.6) == pytest.approx(4.7)


def test_the_focus_on_a_viewpoint_keeps_the_camera_on_its_side_of_the_walls(
    window: MainWindow, document: Document, monkeypatch: pytest.MonkeyPatch
) -> None:
    occupancy, arrays, navigation = document.contents.occupancy, document.graph_arrays, window.scene.navigation
    goals: list[ViewPose] = []
    monkeypatch.setattr(navigation, "go_to", goals.append)  # without the animation
    distances = []
    for heading in (0.0, pi / 2, pi, -pi / 2):
        for id, position in zip(arrays.ids, arrays.positions, strict=True):
            navigation.set_pose(ViewPose((7, 2, 2.2), heading))
            document.editing.select(GraphSelection(frozenset({id})))
            window.actions_table["focus"].trigger()
            camera = np.asarray(goals[-1].position)
            distances.append(np.hypot(*(camera - position)[:2]))
            assert distances[-1] < 1.01 or occupancy.states_at(camera[:2]) != UNKNOWN
    assert min(distances) < 2.0 < max(distances) < 3.01
