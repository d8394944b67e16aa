"""Walking: the eye stays above the floor wherever the hand takes it."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from app.painting.cameras import ViewPose, walked
from app.state.document import Document
from app.wiring.window import MainWindow
from nvsim.graph.types import NavGraph


def test_a_step_ahead_follows_the_heading_and_not_the_eyes() -> None:
    down = ViewPose((0, 0, 1.5), heading=pi / 2, elevation=-1.5)
    assert np.allclose(walked(down, 2.0, 0.0).position, (2, 0, 1.5))
    assert np.allclose(walked(down, 0.0, 1.0).position, (0, -1, 1.5))


def test_walking_brings_the_eye_down_and_keeps_it_there(window: MainWindow, qtbot: QtBot) -> None:
    view = window.scene
    view.navigation.set_pose(ViewPose((7, 2, 4.0), elevation=-0.8))
    window.actions_table["walk"].trigger()
    qtbot.waitUntil(lambda: view.pose.position[2] == pytest.approx(1.5), timeout=3000)
    qtbot.keyPress(view, Qt.Key.Key_W)
    qtbot.waitUntil(lambda: view.pose.position[1] > 2.4, timeout=3000)
    qtbot.keyRelease(view, Qt.Key.Key_W)
    assert view.pose.position[2] == pytest.approx(1.5) and view.pose.elevation == -0.8
    window.actions_table["walk"].trigger()
    qtbot.keyPress(view, Qt.Key.Key_E)
    qtbot.waitUntil(lambda: view.pose.position[2] > 1.7, timeout=3000)
    qtbot.keyRelease(view, Qt.Key.Key_E)


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
