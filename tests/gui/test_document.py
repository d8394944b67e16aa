"""The signals of the document, and when they are sent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import demo_room
import numpy as np
from pytestqt.qtbot import QtBot

from nvsim_app.state.document import Document, Selection
from nvsim_app.state.graph_arrays import GraphArrays, TrajectoryArrays
from nvsim_app.state.loading import Contents


def test_only_the_parts_that_changed_are_announced(qtbot: QtBot, document: Document) -> None:
    with qtbot.waitSignal(document.contentsChanged) as heard:
        document.set_contents(replace(document.contents, training={0: 5}))
    assert heard.args == [frozenset({"training"})]


def test_the_same_contents_are_not_announced(qtbot: QtBot, document: Document) -> None:
    with qtbot.assertNotEmitted(document.contentsChanged):
        document.set_contents(replace(document.contents))


def test_one_thing_is_selected_at_a_time(qtbot: QtBot, document: Document) -> None:
    id = document.graph_arrays.ids[3]
    with qtbot.waitSignal(document.selectionChanged):
        document.select(viewpoint=id)
    document.select(frame=7)
    assert document.selection == Selection(frame=7)
    assert np.allclose(document.selected_point, document.contents.capture.positions[7])


def test_what_does_not_exist_cannot_be_selected(qtbot: QtBot, document: Document) -> None:
    with qtbot.assertNotEmitted(document.selectionChanged):
        document.select(viewpoint="nobody")
        document.select(frame=10_000)
        document.select(submap=99)
    assert not document.selection


def test_a_viewpoint_that_vanishes_is_no_longer_selected(document: Document) -> None:
    document.select(viewpoint=document.graph_arrays.ids[0])
    document.set_contents(replace(document.contents, graph=None))
    assert not document.selection and document.selected_viewpoint is None


def test_another_project_is_announced_before_its_parts(document: Document) -> None:
    order: list[str] = []
    document.projectChanged.connect(lambda: order.append("project"))
    document.contentsChanged.connect(lambda _: order.append("parts"))
    document.set_contents(Contents(Path("other.nvsim")))
    assert order == ["project", "parts"]


def test_graph_arrays_hold_the_same_edges_as_the_graph(document: Document) -> None:
    graph, arrays = document.contents.graph, document.graph_arrays
    assert {frozenset((arrays.ids[a], arrays.ids[b])) for a, b in arrays.edges} == {frozenset(k) for k in graph.edges}
    assert np.allclose(arrays.positions[:, 2] - arrays.feet[:, 2], demo_room.EYE)


def test_the_trajectory_breaks_at_a_jump_and_not_at_another_camera() -> None:
    capture = demo_room.capture(60)
    frames = list(capture.frames)
    moved = frames[30].camera_to_world.copy()
    moved[0, 3] += 40
    frames[30] = replace(frames[30], camera_to_world=moved)
    frames[50:] = [replace(f, sensor=f"photo {i}") for i, f in enumerate(frames[50:])]
    arrays = TrajectoryArrays.of(replace(capture, frames=tuple(frames)), ())
    assert {tuple(pair) for pair in arrays.segments} == {(i, i + 1) for i in range(59)} - {(29, 30), (30, 31)}


def test_the_trajectory_of_a_rig_joins_the_images_of_its_first_camera() -> None:
    capture = demo_room.capture(60)
    frames = [replace(f, rig="robot", sensor=f"camera {i % 3}") for i, f in enumerate(capture.frames)]
    arrays = TrajectoryArrays.of(replace(capture, frames=tuple(frames)), ())
    assert arrays.segments.tolist() == [[i, i + 3] for i in range(0, 57, 3)]


def test_every_frame_belongs_to_the_submap_whose_core_holds_it(document: Document) -> None:
    for submap in document.contents.submaps:
        assert (document.trajectory.submaps[list(submap.core)] == submap.index).all()


def test_an_empty_project_has_empty_arrays() -> None:
    assert GraphArrays.of(None).ids == () and len(TrajectoryArrays.of(None, ()).segments) == 0


def test_what_is_missing_is_named_in_the_order_of_the_stages() -> None:
    full = demo_room.contents(Path("p.nvsim"))
    assert full.missing == ""
    for emptied, words in (
        (Contents(None), "No project is open."),
        (Contents(Path("p.nvsim")), "The project has no capture yet."),
        (replace(full, submaps=(), graph=None, scene_stamp=None), "The trajectory is not divided into submaps yet."),
        (replace(full, scene_stamp=None, graph=None), "No submap is trained completely yet."),
        (replace(full, graph=None), "No navigation graph is built yet."),
    ):
        assert emptied.missing == words
