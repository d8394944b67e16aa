"""A graph with several floors: the window shows one storey at a time, and edits do not change hidden storeys."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from editing_room import Hand
from PySide6.QtWidgets import QApplication

from nvsim.graph.edits import copy_by, move_viewpoints
from nvsim.occupancy.types import FREE, OCCUPIED
from nvsim_app.layers.graph import are_behind_walls
from nvsim_app.painting import cameras
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.state.document import Document
from nvsim_app.wiring.display import StoreyPart
from nvsim_app.wiring.window import MainWindow

UP = 3.0


@pytest.fixture(params=["map", "scene"])
def hand(request: pytest.FixtureRequest, window: MainWindow) -> Hand:
    """The demo room, and the same one floor higher."""
    document = window.document
    graph = copy_by(document.graph, list(document.graph.viewpoints), UP)
    document.set_contents(replace(document.contents, graph=graph))
    window.panels["map"].frame_everything()
    window.scene.navigation.set_pose(cameras.top_view(document.extent, 1.4))
    QApplication.processEvents()
    window.actions_table["show_trajectory"].setChecked(False)
    scene, plan = (canvas.surface for canvas in window.modes.canvases)
    return Hand(window, plan if request.param == "map" else scene)


def floors(document: Document) -> set[float]:
    return {round(float(z)) for z in document.shown_arrays.feet[:, 2]}


def test_one_storey_is_shown_clicked_and_selected(hand: Hand) -> None:
    document, table = hand.document, hand.window.actions_table
    assert floors(document) == {0, 3} and document.shown_arrays is document.graph_arrays
    table["storey_up"].trigger()
    assert floors(document) == {0} and len(document.shown_arrays.ids) == 22
    hand.click(hand.foot(6))
    assert document.editing.selection.viewpoints == {document.graph_arrays.ids[6]}
    table["storey_up"].trigger()
    assert floors(document) == {3}
    hand.click(hand.foot(6) + [0, 0, UP])
    (id,) = document.editing.selection.viewpoints
    assert document.graph.viewpoints[id].position[2] > UP
    table["select_all"].trigger()
    assert len(document.editing.selection.viewpoints) == 22
    table["remove"].trigger()
    assert len(document.graph.viewpoints) == 22, "the storey that nobody saw is still there"


def test_a_viewpoint_is_added_on_the_floor_of_the_storey_that_is_shown(hand: Hand) -> None:
    hand.document.storeys.choose(1)
    hand.window.modes.choose("add_viewpoint")
    hand.click((-0.6, -0.6, UP))
    (id,) = hand.document.editing.selection.viewpoints
    assert hand.document.graph.viewpoints[id].position[2] == pytest.approx(UP + 1.5, abs=0.2)


def test_what_is_selected_elsewhere_comes_into_view(hand: Hand) -> None:
    document = hand.document
    document.storeys.choose(1)
    document.select(viewpoint=document.graph_arrays.ids[3])
    assert document.storeys.chosen == 0


def test_the_choice_over_the_map_names_the_storeys_from_the_top(hand: Hand) -> None:
    part = hand.window.part(StoreyPart)
    words = [part.choice.itemText(i) for i in range(part.choice.count())]
    assert words == ["All storeys", "Storey 2, 3.0 m, 22 viewpoints", "Storey 1, 0.0 m, 22 viewpoints"]
    part.choice.activated.emit(2)
    assert hand.document.storeys.chosen == 0 and part.choice.currentIndex() == 2
    hand.document.editing.undo()
    table = hand.window.actions_table
    table["storey_all"].trigger()
    assert floors(hand.document) == {0, 3}


def test_a_graph_of_one_floor_offers_no_storeys(window: MainWindow) -> None:
    part = window.part(StoreyPart)
    assert part.choice.isHidden() and "one storey" in window.actions_table["storey_up"].toolTip()


def test_other_storeys_are_drawn_faintly_and_left_alone(hand: Hand) -> None:
    document, table, widget = hand.document, hand.window.actions_table, hand.surface.widget
    # Beside the lower storey, so that it does not lie under it.
    above = {id: v.position for id, v in document.graph.viewpoints.items() if v.position[2] > UP}
    graph = move_viewpoints(document.graph, {id: (x + 0.4, y + 0.3, z) for id, (x, y, z) in above.items()})
    document.set_contents(replace(document.contents, graph=graph))
    table["storey_up"].trigger()
    upper = document.storeys.other_storeys(document.graph_arrays)
    assert len(upper.ids) == 22 and set(upper.feet[:, 2].round()) == {UP}
    faint = widget.grab().toImage()
    table["storey_others"].trigger()
    assert not document.storeys.other_storeys(document.graph_arrays).ids
    assert widget.grab().toImage() != faint
    table["storey_others"].trigger()
    assert widget.grab().toImage() == faint
    hand.click(upper.feet[6])
    assert not document.editing.selection.viewpoints & set(upper.ids)


def test_what_is_behind_a_wall_is_faint(window: MainWindow, document: Document) -> None:
    """A wall of the map stands between the eye and half of the room."""
    occupancy = document.contents.occupancy
    cells = np.where(occupancy.cells == OCCUPIED, FREE, occupancy.cells)
    middle = int(np.median((document.graph_arrays.feet[:, 0] - occupancy.origin[0]) / occupancy.resolution)) + 3
    cells[:, middle : middle + 2] = OCCUPIED
    walled = replace(occupancy, cells=cells)
    feet = document.graph_arrays.feet
    wall = occupancy.origin[0] + (middle + 1) * occupancy.resolution
    eye = np.array([feet[:, 0].min() - 0.5, np.median(feet[:, 1]), 1.5])
    assert (are_behind_walls(walled, eye, feet) == (feet[:, 0] > wall)).all()
    assert not are_behind_walls(walled, eye + [0, 0, 40.0], feet).any(), "from above nothing is behind a wall"
    document.set_contents(replace(document.contents, occupancy=walled))
    scene = window.scene
    scene.navigation.set_pose(ViewPose(tuple(eye), np.pi / 2, -0.1))
    view = scene.overlays.graph.projected_viewpoints(scene.overlay_camera)
    assert scene.overlays.graph.hidden(view).sum() == (feet[:, 0] > wall).sum() > 3
    faint = scene.grab().toImage()
    window.actions_table["fade_hidden"].trigger()
    assert scene.grab().toImage() != faint and not scene.overlays.graph.hidden(view).any()
