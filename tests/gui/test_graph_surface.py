"""The map and the 3D view find the same objects under the cursor."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPointF
from PySide6.QtWidgets import QApplication

from nvsim.graph.difference import difference
from nvsim.graph.edits import add_edge, add_viewpoint, move_viewpoint, remove_edge, remove_viewpoints
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim_app.painting import cameras
from nvsim_app.state.document import Document
from nvsim_app.state.graph_arrays import GraphArrays
from nvsim_app.views.graph_surface import GraphSurface, MapSurface, SceneSurface
from nvsim_app.wiring.window import MainWindow


@pytest.fixture(params=["map", "scene"])
def surface(request: pytest.FixtureRequest, window: MainWindow, document: Document) -> GraphSurface:
    window.panels["map"].frame_everything()
    window.scene.navigation.set_pose(cameras.overview(document.extent))
    QApplication.processEvents()
    return (
        MapSurface(window.panels["map"], document) if request.param == "map" else SceneSurface(window.scene, document)
    )


def pixel(surface: GraphSurface, place: np.ndarray) -> QPointF:
    pixels, _ = surface.project(place[None])
    return QPointF(*pixels[0])


def test_a_place_on_the_floor_comes_back_from_its_pixel(surface: GraphSurface, document: Document) -> None:
    for foot in document.graph_arrays.feet[::5]:
        assert surface.floor_point(pixel(surface, foot)) == pytest.approx(tuple(foot), abs=0.02)


def test_a_viewpoint_is_picked_at_its_foot(surface: GraphSurface, document: Document) -> None:
    arrays = document.graph_arrays
    assert surface.pick_viewpoint(pixel(surface, arrays.feet[7])) == arrays.ids[7]
    assert surface.pick_viewpoint(QPointF(-500, -500)) is None


def test_an_edge_is_picked_between_its_ends(surface: GraphSurface, document: Document) -> None:
    arrays = document.graph_arrays
    a, b = arrays.edges[11]
    lines, _, _ = surface.segments(arrays.feet[[a]], arrays.feet[[b]])
    middle = 0.6 * lines[0, :2] + 0.4 * lines[0, 2:]
    assert surface.pick_edge(QPointF(*middle)) == arrays.edge_key(11)


def test_a_polygon_holds_the_viewpoints_whose_feet_are_inside(surface: GraphSurface, document: Document) -> None:
    arrays = document.graph_arrays
    low, high = np.array([1.0, 1.0, 0.0]), np.array([6.0, 4.0, 0.0])
    corners = np.array([low, (high[0], low[1], 0), high, (low[0], high[1], 0)])
    polygon = [QPointF(*p) for p in surface.project(corners)[0]]
    inside = ((arrays.feet >= low) & (arrays.feet <= high)).all(axis=1)
    assert surface.polygon_selection(polygon) == {id for id, held in zip(arrays.ids, inside) if held}


def test_a_frame_is_picked_where_it_is_drawn(surface: GraphSurface, document: Document) -> None:
    place = document.trajectory.positions[30] - [0, 0, 1.5]
    assert surface.pick_frame(pixel(surface, place)) == 30


def as_sets(arrays: GraphArrays) -> tuple[dict, set]:
    """The content of the arrays, independent of the order of their rows."""
    rows = {id: (*arrays.positions[i], *arrays.feet[i], arrays.submaps[i], arrays.included[i])
            for i, id in enumerate(arrays.ids)}  # fmt: skip
    return rows, {arrays.edge_key(i) for i in range(len(arrays.edges))}


def test_updated_arrays_say_the_same_as_new_ones(document: Document) -> None:
    graph = document.contents.graph
    assert graph is not None
    ids, keys = list(graph.viewpoints), list(graph.edges)
    steps: list[NavGraph] = [graph]
    steps.append(remove_edge(steps[-1], *keys[3]))
    steps.append(add_viewpoint(steps[-1], Viewpoint("new", (2.0, 3.0, 1.4), 1.4)))
    steps.append(add_edge(steps[-1], "new", ids[4]))
    steps.append(move_viewpoint(steps[-1], ids[4], (5.0, 5.0, 1.5)))
    steps.append(remove_viewpoints(steps[-1], [ids[0], ids[9], "new"]))
    steps.append(graph)
    steps.append(remove_viewpoints(graph, ids[:-2]))
    arrays = GraphArrays.of(graph)
    for before, after in zip(steps, steps[1:]):
        arrays = arrays.updated(after, difference(before, after))
        assert as_sets(arrays) == as_sets(GraphArrays.of(after))
        assert arrays.index == {id: i for i, id in enumerate(arrays.ids)}
