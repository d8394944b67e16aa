"""Navigate as an agent in the window: the views equal those of the simulator for the same actions."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

import demo_project
import demo_room
import numpy as np
import psutil
import pytest
from editing_room import Hand
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDockWidget, QWidget
from pytestqt.qtbot import QtBot

from nvsim.geometry.directions import VFOV
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.selection import GraphSelection
from nvsim.perception.support import FloorSupport
from nvsim.project.layout import Layout
from nvsim.r2r.simulator import Simulator
from nvsim_app.agent.state import AgentState
from nvsim_app.processes.child import RESTARTS
from nvsim_app.state import edit_commands
from nvsim_app.state.document import Document
from nvsim_app.state.opened_files import GraphSource
from nvsim_app.wiring.agent import AgentPart
from nvsim_app.wiring.inspector import InspectorPart
from nvsim_app.wiring.window import MainWindow

K = Qt.Key
PATIENCE = 60_000  # milliseconds; the first image of a machine compiles what draws it


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = demo_project.write_project(tmp_path_factory.mktemp("agent") / "room.nvsim", count=500, models=4)
    shape = round(demo_room.DEPTH / 0.1), round(demo_room.WIDTH / 0.1)
    FloorSupport(np.ones(shape, bool), (0.0, 0.0), 0.1).save(Layout(root).support)
    return root


class Hands:
    """Navigates in a window, and sends the same actions to a simulator."""

    def __init__(self, window: MainWindow, qtbot: QtBot) -> None:
        self.window, self.document, self.qtbot = window, window.document, qtbot
        self.part = window.part(AgentPart)
        self.walk = self.part.walk
        self.told: list[str] = []  # a notice leaves the screen after some seconds
        window.notices.added.connect(lambda notice: self.told.append(notice.text))

    def begin(self, row: int = 7, heading: float = 0.0) -> None:
        self.document.select(viewpoint=self.document.graph_arrays.ids[row])
        pose = self.window.scene.pose
        self.window.scene.stay_at(replace(pose, heading=heading))
        self.window.actions_table["mode_agent"].trigger()
        self.rest()

    def rest(self) -> None:
        """Until the state is there, and its image or why there is none."""
        self.qtbot.waitUntil(
            lambda: self.walk.state is not None and not self.walk._asked and not self.walk.drawing, timeout=PATIENCE
        )

    def press(self, *keys: Qt.Key, on: QWidget | None = None) -> AgentState:
        for key in keys:
            QTest.keyClick(on or self.part.view, key)
        self.rest()
        return self.state

    @property
    def state(self) -> AgentState:
        assert self.walk.state is not None
        return self.walk.state

    def turn_to(self, locations: int = 1) -> None:
        """Turns until so many locations are navigable."""
        for _ in range(12):
            if len(self.state.navigableLocations) > locations:
                return
            self.press(K.Key_Right)
        raise AssertionError("nowhere are so many in view")


@pytest.fixture
def contents(project: Path) -> Document:
    document = Document()
    document.set_contents(demo_room.contents(project))
    return document


@pytest.fixture
def hands(make_window: Callable[[Document], MainWindow], contents: Document, qtbot: QtBot) -> Iterator[Hands]:
    window = make_window(contents)
    window.resize(1500, 950)
    QApplication.processEvents()
    yield Hands(window, qtbot)


def simulator(project: Path, hands: Hands, restricted: bool = True) -> Simulator:
    """As agents of R2R set it up, at the start of the walk."""
    sim = Simulator()
    sim.setDatasetPath(project)
    sim.setCameraResolution(640, 480)
    sim.setCameraVFOV(VFOV)
    sim.setDiscretizedViewingAngles(True)
    sim.setRestrictedNavigation(restricted)
    start = hands.walk.trajectory[0]
    sim.newEpisode("room", start.viewpoint, start.heading, start.elevation)
    return sim


def place(p: object) -> tuple[object, ...]:
    names = ("viewpointId", "ix", "x", "y", "z", "rel_heading", "rel_elevation", "rel_distance")
    return tuple(getattr(p, name) for name in names)


def assert_same(hands: Hands, sim: Simulator) -> None:
    shown, given = hands.state, sim.getState()
    for name in ("scanId", "step", "heading", "elevation", "viewIndex"):
        assert getattr(shown, name) == getattr(given, name), name
    assert place(shown.location) == place(given.location)
    assert [place(p) for p in shown.navigableLocations] == [place(p) for p in given.navigableLocations]
    # Kernels that two processes compiled at the same time may round a gray value differently.
    apart = np.abs(hands.walk.pixels.astype(int) - given.rgb)
    assert apart.max() <= 1 and np.count_nonzero(apart) < 100


# What is shown ----------------------------------------------------------------------------------------------------


def test_keys_are_the_simulators_actions_and_what_is_shown_is_its_state_and_its_image(
    hands: Hands, project: Path
) -> None:
    hands.begin()
    sim = simulator(project, hands)
    assert_same(hands, sim)
    turns = {K.Key_Right: (1, 0), K.Key_Left: (-1, 0), K.Key_Up: (0, 1), K.Key_Down: (0, -1)}
    for key in (K.Key_Right, K.Key_Up, K.Key_Up, K.Key_Down, K.Key_Left, K.Key_Left, K.Key_0):
        hands.press(key)
        sim.makeAction(0, *turns.get(key, (0, 0)))
        assert_same(hands, sim)
    for _ in range(3):
        while len(hands.state.navigableLocations) < 2:
            hands.press(K.Key_Right)
            sim.makeAction(0, 1, 0)
        last = len(hands.state.navigableLocations) - 1
        hands.press(Qt.Key(K.Key_0 + last))
        sim.makeAction(last, 0, 0)
        assert_same(hands, sim)
    assert len({pose.viewpoint for pose in hands.walk.trajectory}) > 1


def test_without_the_restriction_all_neighbors_are_navigable(hands: Hands, project: Path) -> None:
    hands.begin()
    hands.part.panel.restricted.click()
    hands.rest()
    assert_same(hands, simulator(project, hands, restricted=False))
    graph = hands.document.graph
    assert graph is not None
    ids = {p.viewpointId for p in hands.state.navigableLocations[1:]}
    assert ids == set(graph.neighbors(hands.state.location.viewpointId))


def test_back_and_home_are_as_if_nothing_had_been_done_since(hands: Hands) -> None:
    hands.begin()
    hands.turn_to()
    start, before = hands.walk.trajectory[0], hands.state
    hands.press(K.Key_1)
    assert hands.state.location.viewpointId != before.location.viewpointId
    assert hands.press(K.Key_Backspace) == before
    hands.press(K.Key_1, K.Key_Right, K.Key_Home)
    assert hands.state.pose == start and hands.state.step == 0
    hands.press(K.Key_Backspace)
    assert hands.state.step == 0 and "at its start" in hands.window.modes.refusal


def test_keys_that_come_while_the_simulator_answers_are_done_in_their_order(hands: Hands) -> None:
    hands.begin()
    hands.turn_to()
    goal = hands.state.navigableLocations[1].viewpointId
    hands.press(K.Key_Up, K.Key_Down, K.Key_1)  # no waiting between them
    assert hands.state.location.viewpointId == goal and hands.state.elevation == 0.0


def test_marks_lie_where_the_angles_to_their_locations_say(hands: Hands) -> None:
    hands.begin()
    focal = 240 / math.tan(math.radians(30))
    for _ in range(12):
        for mark in hands.part.view.marks:
            there = hands.state.navigableLocations[mark.index]
            assert mark.viewpoint == there.viewpointId and mark.distance == there.rel_distance
            x = 320 + focal * math.tan(there.rel_heading)
            assert mark.inside == (0 < x < 640)
            # All stand at one height, so that they are on the horizon; a mark is whole.
            expected = min(max(x, 16), 640 - 16)
            assert (mark.x, mark.y) == (pytest.approx(expected, abs=0.01), pytest.approx(240.0, abs=0.01))
        hands.press(K.Key_Right)
    hands.press(K.Key_Up)
    hands.turn_to()
    for mark in hands.part.view.marks:  # what is level lies 30 degrees below, on the image's lower rim
        assert not mark.inside and mark.y == pytest.approx(480 - 16)


def test_no_mark_hides_another_not_even_of_those_behind(hands: Hands) -> None:
    hands.begin()
    hands.part.panel.restricted.click()
    hands.rest()
    for _ in range(12):
        found = hands.part.view.marks
        assert len(found) == len(hands.state.navigableLocations) - 1 >= 3
        for i, one in enumerate(found):
            assert all(max(abs(one.x - other.x), abs(one.y - other.y)) >= 24 for other in found[:i])
            assert 0 < one.x < 640 and 0 < one.y < 480
        hands.press(K.Key_Right)


def test_a_click_on_a_mark_goes_there(hands: Hands, qtbot: QtBot) -> None:
    hands.begin()
    hands.turn_to()
    mark = hands.part.view.marks[0]
    qtbot.mouseClick(hands.part.view, Qt.MouseButton.LeftButton, pos=hands.part.view.spot(mark).toPoint())
    hands.rest()
    assert hands.state.location.viewpointId == mark.viewpoint


def test_a_number_that_no_location_has_is_refused_with_a_sentence(hands: Hands) -> None:
    hands.begin()
    before = hands.state
    hands.press(K.Key_9)
    assert hands.state is before and "no navigable location 9" in hands.window.modes.refusal


# Reading and copying ----------------------------------------------------------------------------------------------


def test_the_panel_shows_every_field_and_copies_all_of_them(hands: Hands) -> None:
    hands.begin()
    hands.turn_to()
    hands.press(K.Key_1)
    hands.turn_to()
    state, panel = hands.state, hands.part.panel
    assert panel.values["viewpointId"].text() == state.location.viewpointId
    assert panel.values["heading"].text().endswith(f"{math.degrees(state.heading):.1f}°")
    assert panel.model.rowCount() == len(state.navigableLocations)
    assert panel.model.index(1, 2).data().startswith(f"{state.navigableLocations[1].rel_heading:.3f} (")
    QTest.keyClick(hands.part.view, K.Key_C, Qt.KeyboardModifier.ControlModifier)
    found = json.loads(QApplication.clipboard().text())
    assert found == json.loads(json.dumps(asdict(state)))
    assert found["location"]["viewpointId"] == state.location.viewpointId and found["viewIndex"] == state.viewIndex
    panel.copy_trajectory.click()
    rows = json.loads(QApplication.clipboard().text())
    assert rows == [[p.viewpoint, p.heading, p.elevation] for p in hands.walk.trajectory]
    assert rows[-1] == [state.location.viewpointId, state.heading, state.elevation] and len(rows) == state.step + 1


def test_a_row_that_is_activated_is_gone_to(hands: Hands) -> None:
    hands.begin()
    hands.turn_to()
    panel, goal = hands.part.panel, hands.state.navigableLocations[1].viewpointId
    panel.table.activated.emit(panel.model.index(1, 1))
    hands.rest()
    assert hands.state.location.viewpointId == goal


# In the window ----------------------------------------------------------------------------------------------------


def test_its_keys_come_before_the_shortcuts_and_are_theirs_again_afterwards(hands: Hands) -> None:
    hands.begin()
    hands.turn_to()
    plan, there = hands.window.panels["map"].plot, hands.state.location.viewpointId
    hands.press(K.Key_1, on=plan)
    assert hands.window.scene.feed.channel == "rgb" and hands.state.location.viewpointId != there
    before = hands.state.viewIndex
    hands.press(K.Key_Left, on=plan)
    assert hands.state.viewIndex == (before - 12 - 1) % 12 + 12
    QTest.keyClick(hands.part.view, K.Key_Escape)
    assert hands.window.modes.current.name == "select" and not hands.walk.active
    assert hands.window.center.currentWidget() is hands.window.scene
    QTest.keyClick(hands.window.scene, K.Key_2)
    assert hands.window.scene.feed.channel == "alpha"


def test_the_selection_and_the_map_follow(hands: Hands) -> None:
    hands.begin()
    hands.turn_to()
    plan = hands.window.panels["map"]
    x, y = hands.state.location.x, hands.state.location.y
    plan.restore_range(x + 20, y + 20, 6, 6)  # elsewhere
    hands.press(K.Key_1)
    assert hands.document.selection.viewpoint == hands.state.location.viewpointId
    left, bottom, width, height = plan.visible_range
    assert left < hands.state.location.x < left + width and bottom < hands.state.location.y < bottom + height


def test_a_click_on_the_map_goes_to_what_is_navigable_and_refuses_the_rest(hands: Hands) -> None:
    hands.begin()
    hands.turn_to()
    hands.window.panels["map"].frame_everything()
    QApplication.processEvents()
    hand = Hand(hands.window, hands.window.modes.canvases[1].surface)
    goal, before = hands.state.navigableLocations[1].viewpointId, hands.state
    near = {p.viewpointId for p in before.navigableLocations}
    arrays = hands.document.graph_arrays
    far = next(row for row, id in enumerate(arrays.ids) if id not in near)
    hand.click(hand.foot(far))
    assert hands.state is before and "not navigable from here" in hands.window.modes.refusal
    hand.click(hand.foot(arrays.index[goal]))
    hands.rest()
    assert hands.state.location.viewpointId == goal


def in_front(window: MainWindow) -> set[str]:
    """Panels that are seen: Qt lays those behind tabs beyond the window."""
    found = window.findChildren(QDockWidget)
    return {dock.objectName() for dock in found if not dock.isHidden() and dock.geometry().right() >= 0}


def test_a_small_window_makes_room_for_the_image_and_takes_it_back(hands: Hands) -> None:
    window = hands.window
    window.resize(1280, 720)
    QApplication.processEvents()
    before = in_front(window)
    hands.begin()
    QApplication.processEvents()
    assert hands.part.view.box.width() >= 640 and hands.part.view.box.height() >= 480
    assert in_front(window) == {"dock_map", "dock_agent"}
    window.actions_table["cancel"].trigger()
    QApplication.processEvents()
    assert in_front(window) == before


def test_the_3d_view_shows_the_agent_in_place_of_its_image(hands: Hands) -> None:
    hands.begin()
    hands.part.panel.image.click()
    assert hands.window.center.currentWidget() is hands.window.scene
    before = hands.state.viewIndex
    hands.press(K.Key_Right, on=hands.window.scene)
    assert hands.state.viewIndex == (before - 11) % 12 + 12
    hands.part.panel.image.click()
    assert hands.window.center.currentWidget() is hands.part.view


def test_regions_are_drawn_only_while_the_inspector_is_looked_at(hands: Hands) -> None:
    inspector = hands.window.part(InspectorPart)
    hands.begin()
    assert inspector.layer.suppressed
    inspector.show_panel()
    QApplication.processEvents()
    assert not inspector.layer.suppressed
    hands.window.actions_table["cancel"].trigger()
    QApplication.processEvents()
    assert not inspector.layer.suppressed


def test_closing_the_project_ends_the_walk(hands: Hands) -> None:
    hands.begin()
    hands.document.set_contents(type(hands.document.contents)())
    assert not hands.walk.active and hands.walk.link.process_id is None
    assert hands.window.modes.current.name == "select"


# Edits ------------------------------------------------------------------------------------------------------------


def removed(hands: Hands, *ids: str) -> None:
    editing = hands.document.editing
    editing.select(GraphSelection(frozenset(ids)))
    hands.window.actions_table["remove"].trigger()


def test_an_edit_elsewhere_leaves_the_walk_as_it_is(hands: Hands) -> None:
    hands.begin()
    hands.turn_to()
    hands.press(K.Key_1)
    before, way = hands.state, hands.walk.trajectory
    far = max(hands.document.graph_arrays.ids, key=lambda id: distance(hands, id))
    removed(hands, far)
    hands.qtbot.waitUntil(lambda: hands.state is not before)
    hands.rest()
    assert hands.state.step == before.step and hands.walk.trajectory == way
    hands.document.editing.undo()
    hands.rest()
    assert hands.walk.trajectory == way


def distance(hands: Hands, id: str) -> float:
    arrays = hands.document.graph_arrays
    return float(np.linalg.norm(arrays.positions[arrays.index[id]] - hands.state.position))


def test_a_viewpoint_that_is_removed_leaves_the_agent_at_the_nearest(hands: Hands) -> None:
    hands.begin()
    gone = hands.state.location.viewpointId
    others = [id for id in hands.document.graph_arrays.ids if id != gone]
    nearest = min(distance(hands, id) for id in others)
    old = hands.state.position
    removed(hands, gone)
    hands.qtbot.waitUntil(lambda: hands.state.location.viewpointId != gone)
    hands.rest()
    assert np.linalg.norm(hands.state.position - old) == pytest.approx(nearest, abs=1e-5)
    assert hands.state.step == 0 and "new episode" in hands.told[-1]
    assert gone not in {p.viewpointId for p in hands.state.navigableLocations}


def test_an_edge_that_was_walked_and_is_gone_begins_a_new_episode_here(hands: Hands) -> None:
    hands.begin()
    hands.turn_to()
    a = hands.state.location.viewpointId
    hands.press(K.Key_1)
    b = hands.state.location.viewpointId
    hands.document.editing.select(GraphSelection(frozenset(), frozenset({tuple(sorted((a, b)))})))
    hands.window.actions_table["remove"].trigger()
    hands.qtbot.waitUntil(lambda: len(hands.walk.trajectory) == 1)
    hands.rest()
    assert hands.state.location.viewpointId == b and hands.state.step == 0 and "new episode" in hands.told[-1]


def test_a_viewpoint_that_is_moved_takes_the_agent_along(hands: Hands) -> None:
    hands.begin()
    id, x, pixels = hands.state.location.viewpointId, hands.state.location.x, hands.walk.pixels
    edit_commands.move(hands.document.editing, [id], (0.2, 0.0, 0.0))
    hands.qtbot.waitUntil(lambda: hands.state.location.x != x)
    hands.rest()
    assert hands.state.location.x == pytest.approx(x + 0.2, abs=1e-5)
    assert not np.array_equal(hands.walk.pixels, pixels)


def test_without_a_viewpoint_left_the_walk_ends_with_a_sentence(hands: Hands) -> None:
    hands.begin()
    removed(hands, *hands.document.graph_arrays.ids)
    hands.qtbot.waitUntil(lambda: not hands.walk.active)
    assert "no included viewpoint left" in hands.told[-1] and hands.window.modes.current.name == "select"
    assert not hands.window.actions_table["mode_agent"].isEnabled()
    assert "no viewpoint that agents can use" in hands.window.actions_table["mode_agent"].toolTip()


def test_an_excluded_viewpoint_is_no_place_to_begin(hands: Hands) -> None:
    id = hands.document.graph_arrays.ids[7]
    hands.document.select(viewpoint=id)
    hands.window.actions_table["exclude"].trigger()
    hands.begin(7)
    assert hands.state.location.viewpointId != id and "excluded" in hands.told[-1]


# Where there is nothing to draw, and where the process dies -------------------------------------------------------


def test_without_models_the_walk_goes_without_images_and_says_why(
    make_window: Callable[[Document], MainWindow], project: Path, qtbot: QtBot
) -> None:
    document = Document()
    document.set_contents(demo_room.contents(project, scene=False))
    hands = Hands(make_window(document), qtbot)
    hands.begin()
    hands.turn_to()
    there = hands.state.location.viewpointId
    hands.press(K.Key_1)
    assert hands.state.location.viewpointId != there
    assert hands.walk.pixels is None and "no submap is trained completely yet" in hands.walk.no_image


def test_a_process_that_dies_is_started_again_and_the_walk_goes_on(hands: Hands) -> None:
    hands.begin()
    hands.press(K.Key_Right)
    before, old = hands.state, hands.walk.link.process_id
    assert old is not None
    psutil.Process(old).kill()
    hands.qtbot.waitUntil(lambda: any("restarted" in text for text in hands.told), timeout=PATIENCE)
    hands.press(K.Key_Right)
    assert hands.state.step == before.step + 1 and hands.walk.link.process_id not in (None, old)


def test_a_process_that_dies_again_and_again_ends_the_walk_with_a_sentence(hands: Hands) -> None:
    hands.begin()
    for _ in range(RESTARTS + 1):
        link = hands.walk.link
        hands.qtbot.waitUntil(lambda: link.ready and link.process_id is not None, timeout=PATIENCE)  # noqa: B023
        process = link.process_id
        assert process is not None
        psutil.Process(process).kill()
        hands.qtbot.waitUntil(lambda: hands.walk.link.process_id != process, timeout=PATIENCE)  # noqa: B023
    hands.qtbot.waitUntil(lambda: not hands.walk.active, timeout=PATIENCE)
    assert "stopped repeatedly" in hands.told[-1] and hands.window.modes.current.name == "select"
    hands.begin()
    assert hands.state.step == 0


def test_a_window_that_closes_while_the_process_starts_leaves_nothing(hands: Hands) -> None:
    hands.window.actions_table["mode_agent"].trigger()
    assert hands.walk.active and hands.walk.state is None
    QTest.keyClick(hands.part.view, K.Key_Right)  # nobody knows yet where the agent stands
    hands.window.close()
    assert not hands.walk.active and hands.walk.link.process_id is None


def exported(folder: Path) -> Path:
    """The room as a connectivity file."""
    graph = demo_room.contents().graph
    assert graph is not None
    return write_connectivity(replace(graph, scan="room"), folder)


def opened(path: Path, make_window: Callable[[Document], MainWindow], qtbot: QtBot) -> Hands:
    document = Document()
    document.set_contents(GraphSource(path).contents())
    return Hands(make_window(document), qtbot)


def test_a_graph_without_images_is_walked_and_says_so(
    make_window: Callable[[Document], MainWindow], tmp_path: Path, qtbot: QtBot
) -> None:
    hands = opened(exported(tmp_path), make_window, qtbot)
    hands.begin()
    assert hands.state.scanId == "room" and "the folder of the file has no skyboxes" in hands.walk.no_image
    hands.turn_to()
    hands.press(K.Key_1)
    assert hands.state.step > 0
    hands.document.editing.close()


def test_skyboxes_beside_a_graph_are_what_the_agent_sees(
    make_window: Callable[[Document], MainWindow], tmp_path: Path, qtbot: QtBot
) -> None:
    import cv2

    path = exported(tmp_path)
    folder = tmp_path / "scans" / "room" / "matterport_skybox_images"
    folder.mkdir(parents=True)
    noise = np.random.default_rng(1)
    graph = demo_room.contents().graph
    assert graph is not None
    for id in graph.viewpoints:
        coarse = noise.integers(0, 255, (8, 48, 3), np.uint8)
        strip = cv2.resize(coarse, (6 * 64, 64), interpolation=cv2.INTER_LINEAR)
        cv2.imwrite(str(folder / f"{id}_skybox_small.jpg"), strip)
    hands = opened(path, make_window, qtbot)
    hands.begin()
    sim = Simulator()
    sim.setNavGraphPath(tmp_path)
    sim.setDatasetPath(tmp_path / "scans")
    sim.setCameraResolution(640, 480)
    sim.setCameraVFOV(VFOV)
    sim.setDiscretizedViewingAngles(True)
    start = hands.walk.trajectory[0]
    sim.newEpisode("room", start.viewpoint, start.heading, start.elevation)
    assert_same(hands, sim)
    hands.press(K.Key_Right, K.Key_Up)
    sim.makeAction(0, 1, 0)
    sim.makeAction(0, 0, 1)
    assert_same(hands, sim)
    hands.document.editing.close()


def test_a_project_that_is_gone_is_a_sentence_in_the_images_place(hands: Hands, project: Path, tmp_path: Path) -> None:
    copy = tmp_path / "gone.nvsim"
    shutil.copytree(project, copy)
    hands.document.set_contents(replace(hands.document.contents, path=copy))
    shutil.rmtree(copy)
    hands.begin()
    assert hands.walk.pixels is None and "gone.nvsim" in hands.walk.no_image
