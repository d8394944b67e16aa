"""Every mode of editing, in the map and in the 3D view alike."""

from __future__ import annotations

import numpy as np
import pytest
from editing_room import ALT, CTRL, SHIFT, Hand
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from nvsim_app.painting import cameras
from nvsim_app.wiring.modes import ContextPart
from nvsim_app.wiring.window import MainWindow


@pytest.fixture(params=["map", "scene"])
def hand(request: pytest.FixtureRequest, window: MainWindow) -> Hand:
    window.panels["map"].frame_everything()
    window.scene.navigation.set_pose(cameras.top_view(window.document.extent, 1.4))
    QApplication.processEvents()
    scene, plan = (canvas.surface for canvas in window.modes.canvases)
    made = Hand(window, plan if request.param == "map" else scene)
    window.actions_table["show_trajectory"].setChecked(False)
    return made


def ids(hand: Hand, *rows: int) -> frozenset[str]:
    return frozenset(hand.document.graph_arrays.ids[row] for row in rows)


def test_a_click_selects_shift_adds_and_ctrl_toggles(hand: Hand) -> None:
    editing = hand.document.editing
    hand.click(hand.foot(3))
    assert editing.selection.viewpoints == ids(hand, 3)
    assert hand.document.selection.viewpoint == hand.document.graph_arrays.ids[3]
    hand.click(hand.foot(8), SHIFT)
    assert editing.selection.viewpoints == ids(hand, 3, 8)
    assert not hand.document.selection
    hand.click(hand.foot(3), CTRL)
    assert editing.selection.viewpoints == ids(hand, 8)
    hand.click(hand.foot(8), CTRL)
    assert not editing.selection


def test_an_edge_is_selected_by_a_click_on_it(hand: Hand) -> None:
    arrays = hand.document.graph_arrays
    a, b = arrays.feet[arrays.edges[11]]
    hand.click(0.55 * a + 0.45 * b)
    assert hand.document.editing.selection.edges == {arrays.edge_key(11)}
    assert not hand.document.editing.selection.viewpoints


def test_a_click_beside_everything_selects_nothing(hand: Hand) -> None:
    hand.click(hand.foot(3))
    hand.click((-0.6, -0.6, 0.0))
    assert not hand.document.editing.selection and not hand.document.selection


def test_what_is_selected_is_moved_by_one_drag_and_one_step(hand: Hand) -> None:
    document = hand.document
    id = document.graph_arrays.ids[6]
    before, foot = document.graph, hand.foot(6).copy()
    assert before is not None
    hand.click(foot)
    steps = len(document.editing.history.steps)
    hand.drag(foot, foot + [0.5, 0.2, 0], foot + [0.4, -0.6, 0])
    after = document.graph
    assert after is not None and len(document.editing.history.steps) == steps + 1
    moved = np.subtract(after.viewpoints[id].position, before.viewpoints[id].position)
    assert moved == pytest.approx([0.4, -0.6, 0.0], abs=0.06)
    assert set(after.edges) == set(before.edges)
    document.editing.undo()
    assert document.graph is before


def test_a_drag_from_what_is_not_selected_edits_nothing(hand: Hand) -> None:
    before = hand.document.graph
    hand.drag(hand.foot(6), hand.foot(6) + [0.7, 0.3, 0])
    assert hand.document.graph is before


def test_escape_gives_a_drag_up(hand: Hand) -> None:
    before, foot = hand.document.graph, hand.foot(6).copy()
    hand.click(foot)
    mode = hand.window.modes.current
    from nvsim_app.modes.mode import Pointer

    start = Pointer(hand.surface, hand.pixel(foot).toPointF())
    assert mode.takes_drag(start)
    mode.drag(start, Pointer(hand.surface, hand.pixel(foot + [1, 0, 0]).toPointF()))
    hand.window.actions_table["cancel"].trigger()
    assert hand.document.graph is before and hand.document.editing.selection.viewpoints == ids(hand, 6)


def test_the_button_that_comes_up_after_escape_does_nothing(hand: Hand) -> None:
    before, foot, widget = hand.document.graph, hand.foot(6).copy(), hand.surface.widget
    hand.click(foot)
    QTest.mousePress(widget, Qt.MouseButton.LeftButton, pos=hand.pixel(foot))
    for way in (0.3, 0.9):
        hand._move(hand.pixel(foot + [way, way, 0]), Qt.KeyboardModifier.NoModifier)
    hand.window.actions_table["cancel"].trigger()
    hand._move(hand.pixel(foot + [1.5, 1.2, 0]), Qt.KeyboardModifier.NoModifier)
    QTest.mouseRelease(widget, Qt.MouseButton.LeftButton, pos=hand.pixel(foot + [1.5, 1.2, 0]))
    assert hand.document.graph is before and hand.document.editing.selection.viewpoints == ids(hand, 6)
    hand.drag(foot, foot + [0.3, 0.1, 0], foot + [0.6, 0.2, 0])
    assert hand.document.graph is not before, "the next drag counts again"


def test_ctrl_and_a_drag_selects_by_a_box(hand: Hand) -> None:
    feet = hand.document.graph_arrays.feet
    hand.drag((-0.5, -0.5, 0), (6.0, 4.0, 0), keys=CTRL)
    inside = (feet[:, 0] < 6.0) & (feet[:, 1] < 4.0)
    assert hand.document.editing.selection.viewpoints == ids(hand, *np.flatnonzero(inside))


def test_the_box_mode_selects_and_shift_adds(hand: Hand) -> None:
    hand.window.actions_table["mode_box"].trigger()
    hand.drag((-0.5, -0.5, 0), (2.5, 9.0, 0))
    left = hand.document.editing.selection.viewpoints
    hand.drag((11.5, -0.5, 0), (14.5, 9.0, 0), keys=SHIFT)
    feet = hand.document.graph_arrays.feet
    assert left == ids(hand, *np.flatnonzero(feet[:, 0] < 2.5))
    assert hand.document.editing.selection.viewpoints == left | ids(hand, *np.flatnonzero(feet[:, 0] > 11.5))
    assert hand.window.modes.current.name == "box"
    hand.window.actions_table["cancel"].trigger()
    assert hand.window.modes.current.name == "select"
    assert hand.window.actions_table["mode_select"].isChecked()


def test_the_lasso_selects_what_it_goes_around(hand: Hand) -> None:
    hand.window.actions_table["mode_lasso"].trigger()
    hand.drag((-0.5, -0.5, 0), (5.0, -0.5, 0), (-0.5, 5.0, 0))
    feet = hand.document.graph_arrays.feet
    assert hand.document.editing.selection.viewpoints == ids(hand, *np.flatnonzero(feet[:, 0] + feet[:, 1] < 4.5))


def test_a_viewpoint_is_added_on_the_floor_where_one_clicks(hand: Hand) -> None:
    hand.window.actions_table["mode_add_viewpoint"].trigger()
    count = len(hand.document.graph.viewpoints)
    hand.hover((2.2, 2.2, 0.0))
    hand.click((2.2, 2.2, 0.0), ALT)
    graph = hand.document.graph
    assert len(graph.viewpoints) == count + 1
    new = list(graph.viewpoints.values())[-1]
    assert new.position == pytest.approx((2.2, 2.2, 1.5), abs=0.06) and new.height == pytest.approx(1.5, abs=0.01)
    assert new.origin == "person"
    assert hand.document.editing.selection.viewpoints == {new.id}
    assert hand.document.selection.viewpoint == new.id


def test_shift_joins_a_new_viewpoint_to_the_selected_one(hand: Hand) -> None:
    hand.click(hand.foot(3))
    start = hand.document.graph_arrays.ids[3]
    steps = len(hand.document.editing.history.steps)
    hand.window.actions_table["mode_add_viewpoint"].trigger()
    hand.click((2.2, 2.2, 0.0), SHIFT | ALT)
    graph = hand.document.graph
    new = list(graph.viewpoints)[-1]
    assert (min(start, new), max(start, new)) in graph.edges
    assert len(hand.document.editing.history.steps) == steps + 1


def test_a_click_on_a_frame_takes_its_place(hand: Hand) -> None:
    hand.window.actions_table["show_trajectory"].setChecked(True)
    hand.window.actions_table["mode_add_viewpoint"].trigger()
    arrays, walk = hand.document.graph_arrays, hand.document.trajectory.positions
    # A frame that is far from every viewpoint and edge.
    ends = arrays.positions[arrays.edges]
    middles = np.concatenate([ends[:, 0] + share * (ends[:, 1] - ends[:, 0]) for share in np.linspace(0, 1, 9)])
    frame = int(np.argmax(np.linalg.norm(walk[:, None] - middles[None], axis=2).min(axis=1)))
    hand.click(walk[frame] - [0, 0, 1.5])
    new = list(hand.document.graph.viewpoints.values())[-1]
    assert np.linalg.norm(walk - np.array(new.position), axis=1).min() < 1e-9


def test_a_click_on_an_edge_parts_it(hand: Hand) -> None:
    arrays = hand.document.graph_arrays
    key = arrays.edge_key(11)
    a, b = arrays.feet[arrays.edges[11]]
    hand.window.actions_table["mode_add_viewpoint"].trigger()
    hand.click(0.6 * a + 0.4 * b)
    graph = hand.document.graph
    new = list(graph.viewpoints.values())[-1]
    assert key not in graph.edges
    assert all((min(end, new.id), max(end, new.id)) in graph.edges for end in key)
    assert np.array(new.position)[:2] == pytest.approx((0.6 * a + 0.4 * b)[:2], abs=0.06)


def apart(hand: Hand) -> tuple[int, int]:
    """Two viewpoints that are not joined."""
    arrays, keys = hand.document.graph_arrays, set(hand.document.graph.edges)
    for i in range(len(arrays.ids)):
        for j in range(i + 1, len(arrays.ids)):
            a, b = sorted((arrays.ids[i], arrays.ids[j]))
            if (a, b) not in keys and np.linalg.norm(arrays.feet[i] - arrays.feet[j]) > 3:
                return i, j
    raise AssertionError("everything is joined")


def test_two_clicks_join_two_viewpoints(hand: Hand) -> None:
    i, j = apart(hand)
    a, b = sorted(ids(hand, i, j))
    hand.window.actions_table["mode_add_edge"].trigger()
    hand.click(hand.foot(i))
    hand.hover(hand.foot(j))
    hand.click(hand.foot(j))
    assert hand.document.graph.edges[a, b].origin == "person"


def test_a_drag_joins_two_viewpoints_too(hand: Hand) -> None:
    i, j = apart(hand)
    a, b = sorted(ids(hand, i, j))
    hand.window.actions_table["mode_add_edge"].trigger()
    hand.drag(hand.foot(i), hand.foot(j))
    assert (a, b) in hand.document.graph.edges


def test_an_edge_that_is_there_already_is_refused_at_the_cursor(hand: Hand) -> None:
    arrays = hand.document.graph_arrays
    i, j = arrays.edges[4]
    before = hand.document.graph
    hand.window.actions_table["mode_add_edge"].trigger()
    hand.click(hand.foot(i))
    hand.click(hand.foot(j))
    assert hand.document.graph is before
    assert "already" in hand.window.modes.refusal and "already" in hand.window.statusBar().currentMessage()


def test_measuring_says_meters_and_edits_nothing(hand: Hand) -> None:
    before = hand.document.graph
    hand.window.actions_table["mode_measure"].trigger()
    hand.click((2.0, 2.0, 0.0), ALT)
    hand.hover((3.0, 2.0, 0.0))
    hand.click((5.0, 6.0, 0.0), ALT)
    assert hand.window.modes.current.meters == pytest.approx(5.0, abs=0.12)
    assert f"{hand.window.modes.current.meters:.2f} m" in hand.window.statusBar().currentMessage()
    hand.key(Qt.Key.Key_Backspace)
    assert hand.window.modes.current.meters == 0
    hand.window.actions_table["cancel"].trigger()
    assert hand.document.graph is before and hand.window.modes.current.name == "measure"


def test_arrow_keys_nudge_and_one_series_is_one_step(hand: Hand) -> None:
    hand.click(hand.foot(6))
    id = hand.document.graph_arrays.ids[6]
    start = hand.document.graph.viewpoints[id].position
    steps = len(hand.document.editing.history.steps)
    hand.key(Qt.Key.Key_Right)
    hand.key(Qt.Key.Key_Up, SHIFT)
    assert np.subtract(hand.document.graph.viewpoints[id].position, start) == pytest.approx([0.05, 0.5, 0.0])
    assert len(hand.document.editing.history.steps) == steps + 1
    hand.click(hand.foot(9))
    hand.key(Qt.Key.Key_Left)
    hand.document.editing.undo()
    assert hand.document.graph.viewpoints[id].position != start, "what was selected later was nudged by itself"


def test_the_status_bar_says_what_a_click_does(hand: Hand) -> None:
    for name, words in (("add_edge", "connect"), ("measure", "measure"), ("select", "selects")):
        hand.window.actions_table[f"mode_{name}"].trigger()
        assert words in hand.window.statusBar().currentMessage()


def right_click(hand: Hand, place: np.ndarray | tuple[float, ...]) -> list[str]:
    """The entries of the context menu at this position, without the marks of underlined letters."""
    menus = []
    hand.window.modes.menuWanted.connect(menus.append)
    point = hand.pixel(place)
    QTest.mousePress(hand.surface.widget, Qt.MouseButton.RightButton, pos=point)
    QTest.mouseRelease(hand.surface.widget, Qt.MouseButton.RightButton, pos=point)
    hand.window.modes.menuWanted.disconnect(menus.append)
    assert len(menus) == 1
    part = hand.window.part(ContextPart)
    opened = QApplication.activePopupWidget()
    if opened is not None:
        opened.close()
    return [action.text().replace("&", "") for action in part.menu(menus[0]).actions() if not action.isSeparator()]


def test_the_right_button_offers_what_can_be_done_to_a_viewpoint(hand: Hand) -> None:
    words = right_click(hand, hand.foot(5))
    assert hand.document.editing.selection.viewpoints == ids(hand, 5)
    assert {"Delete", "Exclude", "Set height…", "Mark as reviewed", "Zoom to selection"} <= set(words)
    assert "Join" not in words and "Split" not in words
    hand.click(hand.foot(6), SHIFT)
    assert {"Join", "Merge", "Select path between"} <= set(right_click(hand, hand.foot(5)))
    assert hand.document.editing.selection.viewpoints == ids(hand, 5, 6)


def test_the_right_button_offers_a_viewpoint_on_the_floor(hand: Hand) -> None:
    hand.click(hand.foot(5))
    before = hand.document.graph
    words = right_click(hand, (-0.6, -0.6, 0.0))
    assert words[0] == "Add a viewpoint here" and words[1].startswith("Add a viewpoint here and connect it to ")
    assert hand.document.graph is before


def test_a_drag_with_the_right_button_opens_no_menu(hand: Hand) -> None:
    wanted: list[object] = []
    hand.window.modes.menuWanted.connect(wanted.append)
    a, b = hand.pixel(hand.foot(5)), hand.pixel(hand.foot(5) + [1.0, 0.0, 0])
    QTest.mousePress(hand.surface.widget, Qt.MouseButton.RightButton, pos=a)
    QTest.mouseMove(hand.surface.widget, b)
    QTest.mouseRelease(hand.surface.widget, Qt.MouseButton.RightButton, pos=b)
    assert not wanted


def test_what_was_reviewed_and_locked_is_marked_where_it_stands(hand: Hand) -> None:
    marks, document = hand.window.modes._reviewed, hand.document
    arrays, key = document.graph_arrays, document.graph_arrays.edge_key(11)

    def ticks() -> np.ndarray:
        hand.surface.widget.grab()
        return marks._drawn[1]

    assert len(ticks()) == 0
    document.editing.run("mark_reviewed", {"viewpoints": [arrays.ids[4]], "edges": [list(key)]})
    middle = arrays.feet[arrays.edges[11]].mean(axis=0)
    assert sorted(map(tuple, ticks())) == sorted(map(tuple, (arrays.feet[4], middle)))
    document.editing.run("lock", {"viewpoints": [arrays.ids[7]]})
    hand.surface.widget.grab()
    assert marks._drawn[2].tolist() == [arrays.feet[7].tolist()]
    document.editing.undo()
    document.editing.undo()
    assert len(ticks()) == 0 and len(marks._drawn[2]) == 0
