"""Points near a walk, against the distance to every place of it."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nvsim.capture.types import Cloud
from nvsim.geometry.cells import near_places


@given(st.integers(0, 10_000), st.floats(0.5, 30))
def test_none_that_is_near_is_left_out_and_none_that_is_far_is_kept(seed: int, reach: float) -> None:
    rng = np.random.default_rng(seed)
    places = rng.uniform(-20, 20, (int(rng.integers(1, 6)), 3))
    points = rng.uniform(-70, 70, (300, 3)).astype(np.float32)
    apart = np.linalg.norm(points[:, None, :2] - places[None, :, :2], axis=2).min(axis=1)
    kept = near_places(points, places, reach)
    assert kept[apart < reach].all()
    assert not kept[apart > reach + 3].any()


def test_a_cloud_keeps_what_belongs_to_its_points() -> None:
    points = np.array([[0, 0, 0], [50, 0, 0], [3, 0, 1], [np.nan, 0, 0]], np.float32)
    cloud = Cloud(points, np.arange(12, dtype=np.uint8).reshape(4, 3), "images", np.eye(4, 3, dtype=np.float32))
    near = cloud.near(np.zeros((1, 3)), 5.0)
    assert near.points.tolist() == [[0, 0, 0], [3, 0, 1]] and near.kind == "images"
    assert near.colors is not None and near.colors.tolist() == [[0, 1, 2], [6, 7, 8]]
    assert near.normals is not None and near.normals.tolist() == [[1, 0, 0], [0, 0, 1]]
    small = Cloud(points[:1])
    assert small.near(np.zeros((2, 2)), 1.0) is small


def test_no_place_is_near_nothing() -> None:
    assert not near_places(np.zeros((3, 3)), np.zeros((0, 3)), 1.0).any()
