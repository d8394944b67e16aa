"""Figures and pictures of graphs on maps whose answers are known in closed form."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from columns import fill, room
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.evaluation.graph import evaluate_graph
from nvsim.evaluation.interval import wilson
from nvsim.evaluation.picture import draw_graph
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.occupancy.types import OCCUPIED, UNKNOWN

WALK = np.array([[1.0, 1.0], [2.0, 1.0]])


def graph(places: dict[str, tuple[float, float]], joined: str = "") -> NavGraph:
    viewpoints = {id: Viewpoint(id, (*xy, 1.2)) for id, xy in places.items()}
    edges = {e.key: e for e in (edge(*pair) for pair in joined.split())}
    return NavGraph("test", viewpoints, edges)


def test_validity_counts_what_stands_on_and_runs_over_free_cells() -> None:
    occupancy = fill(room(6, 4), 2.95, 1, 3.05, 4, OCCUPIED)
    places = {"a": (1, 0.5), "b": (5, 0.5), "c": (1, 3), "d": (5, 3), "e": (3, 3), "f": (-2, 1), "g": (0.1, 2)}
    figures = evaluate_graph(graph(places, "ab ac cd ce af ag"), occupancy, WALK)
    assert (figures["nodes"], figures["edges"]) == (7, 6)
    assert figures["node_validity"] == pytest.approx(5 / 7, abs=1e-5), "in a wall and on unknown ground"
    assert figures["node_validity_robot"] == pytest.approx(4 / 7, abs=1e-5), "and too near to a wall"
    assert figures["edge_validity"] == pytest.approx(3 / 6), "ab, ac, ag"
    assert figures["edge_validity_robot"] == pytest.approx(2 / 6, abs=1e-5)
    assert figures["components"] == 1 and figures["largest_component"] == 1
    assert (figures["valid_nodes"], figures["valid_edges_robot"]) == (5, 2)
    assert (figures["edge_validity_low"], figures["edge_validity_high"]) == pytest.approx(wilson(3, 6), abs=1e-5)


def test_coverage_is_the_seen_share_of_what_the_walk_reaches() -> None:
    occupancy = fill(room(12, 4), 5.95, 0, 6.05, 4, OCCUPIED)
    figures = evaluate_graph(graph({"a": (3, 2)}), occupancy, WALK)
    # A disc of 2.5 m radius in a strip 4 m wide, of 5.95 x 4 m.
    outside = 2 * (2.5**2 * np.arccos(2 / 2.5) - 2 * np.sqrt(2.5**2 - 4))
    assert figures["coverage"] == pytest.approx((np.pi * 2.5**2 - outside) / (5.95 * 4), abs=0.01)
    assert figures["reachable_m2"] == pytest.approx(5.95 * 4, rel=0.01)
    behind = evaluate_graph(graph({"a": (9, 2)}), occupancy, WALK)
    assert behind["coverage"] == 0 and behind["node_validity"] == 1
    assert evaluate_graph(graph({"a": (6, 2)}), occupancy, WALK)["coverage"] == 0, "an invalid viewpoint covers nothing"


def test_coverage_of_what_was_seen_leaves_out_what_no_image_shows() -> None:
    def left_half(xy: NDArray[np.floating]) -> NDArray[np.bool_]:
        return np.asarray(xy[..., 0] < 3)

    places = graph({"a": (1.5, 2)})
    figures = evaluate_graph(places, room(6, 4), WALK, seen=left_half)
    assert figures["seen_m2"] == pytest.approx(3 * 4, rel=0.02)
    # A disc of 2.5 m around the middle of a room 3 x 4 m reaches into its corners.
    assert figures["coverage_seen"] == 1 and figures["coverage"] < 0.75
    assert evaluate_graph(places, room(6, 4), WALK, seen=lambda xy: ~left_half(xy))["coverage_seen"] < 0.4
    assert "coverage_seen" not in evaluate_graph(places, room(6, 4), WALK)


def test_excluded_viewpoints_do_not_count_and_components_do() -> None:
    found = graph({"a": (1, 1), "b": (2, 1), "c": (4, 1), "d": (-3, 1)}, "ab bd")
    excluded = {**found.viewpoints, "d": Viewpoint("d", (-3, 1, 1.2), included=False)}
    figures = evaluate_graph(NavGraph("test", excluded, found.edges), room(6, 4), WALK)
    assert (figures["nodes"], figures["edges"], figures["node_validity"]) == (3, 1, 1.0)
    assert (figures["components"], figures["isolated"]) == (2, 1)


def test_empty_graph_has_figures_too() -> None:
    figures = evaluate_graph(NavGraph("test"), room(4, 4), WALK)
    assert (figures["nodes"], figures["edges"], figures["coverage"], figures["components"]) == (0, 0, 0.0, 0)


def test_picture_shows_what_is_invalid_in_red(tmp_path: Path) -> None:
    occupancy = fill(room(6, 4), 4, 1, 5, 3, UNKNOWN)
    path = draw_graph(graph({"a": (1, 1), "b": (4.5, 2)}, "ab"), occupancy, WALK, tmp_path / "g.png", 700)
    picture = cv2.imread(str(path))
    # The known part is 6.2 x 4.2 m, with 0.5 m around it.
    scale = 700 / 7.2

    def pixel(x: float, y: float) -> tuple[int, ...]:
        return tuple(int(v) for v in picture[round((4.6 - y) * scale), round((x + 0.6) * scale)])

    assert max(picture.shape) == 700
    red = pixel(4.5, 2)
    assert red[2] > 150 and max(red[:2]) < 80
    assert pixel(1, 1) != red and min(pixel(2, 3)) > 240
    draw_graph(graph({"a": (1, 1)}), None, WALK, tmp_path / "none.png")
    draw_graph(NavGraph("test"), None, np.zeros((0, 2)), tmp_path / "nothing.png")
    with pytest.raises(InputError, match="image"):
        draw_graph(NavGraph("test"), None, WALK, tmp_path / "g.txt")
