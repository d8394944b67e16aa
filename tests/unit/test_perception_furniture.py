"""A graph on furniture is recognized by the points under it."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.capture.types import Cloud
from nvsim.perception.furniture import share_without_points_below, short_walk, uneven_height_range


def room(rng: np.random.Generator) -> Cloud:
    """A floor at z = 0 with a table of 2 x 1 m at z = 0.75 in its middle."""
    floor = np.column_stack([rng.uniform(-3, 3, (20000, 2)), rng.normal(0, 0.01, 20000)])
    table = np.column_stack([rng.uniform((-1, -0.5), (1, 0.5), (8000, 2)), rng.normal(0.75, 0.005, 8000)])
    return Cloud(np.concatenate([floor, table]).astype(np.float32), None, "sfm")


def test_viewpoints_on_a_table_have_points_under_them() -> None:
    cloud = room(np.random.default_rng(0))
    around = np.array([(-2.0, 0.0), (0.0, 2.0), (2.0, -1.0)])
    on_floor = np.column_stack([around, np.zeros(3)])
    on_table = np.array([(x, 0.0, 0.75) for x in (-0.5, 0.0, 0.5)])
    assert share_without_points_below(cloud, on_floor) == 1
    assert share_without_points_below(cloud, on_table) == 0
    assert share_without_points_below(cloud, np.concatenate([on_floor, on_table])) == 0.5


def test_without_evidence_a_graph_stands_on_the_floor() -> None:
    assert share_without_points_below(None, np.zeros((2, 3))) == 1
    assert share_without_points_below(room(np.random.default_rng(0)), np.zeros((0, 3))) == 1
    assert share_without_points_below(Cloud(np.full((9, 3), 50, np.float32), None, "sfm"), np.zeros((2, 3))) == 1


def test_a_storey_below_is_no_furniture() -> None:
    cloud = room(np.random.default_rng(0))
    lower = Cloud(np.concatenate([cloud.points, cloud.points - np.float32([0, 0, 3])]), None, "lidar")
    assert share_without_points_below(lower, np.array([(2.0, 2.0, 0.0)])) == 1


def test_a_carried_camera_has_an_even_height_and_cameras_around_a_table_do_not() -> None:
    rng = np.random.default_rng(0)
    assert uneven_height_range(1.6 + 0.05 * rng.normal(size=200)) is None
    assert uneven_height_range(np.append(np.full(60, 1.2), [0.3, 2.2])) is None, "two outliers are no evidence"
    assert uneven_height_range(np.zeros(0)) is None
    low, high = uneven_height_range(rng.uniform(0.77, 2.0, 50)) or (0, 0)
    assert 0.8 < low < 1.0 and 1.8 < high < 2.0


def test_cameras_that_hardly_move_may_show_a_desk() -> None:
    turned = np.array([(0.0, 0.0, 1.4), (0.6, 0.8, 1.5), (0.3, 0.4, 1.3)])  # a meter apart, in no axis
    assert short_walk(turned, np.full(3, 1.4)) == pytest.approx(1.0, abs=0.01)
    assert short_walk(1.5 * turned, np.full(3, 1.4)) is None
    assert short_walk(turned, np.zeros(0)) is None
