"""Floors over one another, against heights known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from stairwell import SLOPE, stairwell

from nvsim.geometry.floor_surface import FloorSurface, StackedFloor

HOUSE = StackedFloor((FloorSurface.flat(0.1), FloorSurface.flat(3.0), FloorSurface.flat(6.2)))


@pytest.mark.parametrize(
    ("z", "storey"),
    [(-2.0, 0), (0.1, 0), (1.6, 0), (2.4, 0), (2.6, 1), (3.0, 1), (4.4, 1), (5.8, 2), (7.5, 2), (30.0, 2)],
)
def test_a_height_belongs_to_the_highest_floor_that_is_not_above_it(z: float, storey: int) -> None:
    point = np.array([0.3, -4.0, z])
    assert HOUSE.storey_at(point) == storey
    assert HOUSE.height_at(point) == pytest.approx((0.1, 3.0, 6.2)[storey])


def test_places_without_a_height_are_on_the_lowest_floor() -> None:
    assert HOUSE.height_at(np.zeros((4, 5, 2))).shape == (4, 5) and (HOUSE.height_at(np.zeros((4, 5, 2))) < 0.2).all()
    mixed = np.zeros((2, 3, 3))
    mixed[1, :, 2] = 4.3
    np.testing.assert_allclose(HOUSE.height_at(mixed), [[0.1] * 3, [3.0] * 3], rtol=1e-6)


def test_one_floor_gives_points_what_it_gives_places() -> None:
    surface = FloorSurface(np.random.default_rng(0).normal(size=(5, 7)).astype(np.float32), (-1.0, 2.0), 0.5)
    points = np.random.default_rng(1).uniform(-3, 6, (100, 3))
    assert np.array_equal(surface.height_at(points), surface.height_at(points[:, :2]))
    alone = StackedFloor((surface,))
    assert (np.abs(alone.height_at(points) - surface.height_at(points)) < 1e-6).sum() > 20


def test_a_stair_is_met_from_both_storeys_and_from_itself() -> None:
    floor = stairwell()
    for x in np.arange(2.15, 6.9, 0.1):
        height = SLOPE * (x - 2)
        for z in (1.3, height, height + 1.3, 4.3):
            assert floor.height_at(np.array([x, 0.5, z])) == pytest.approx(height, abs=0.031)


def test_beside_a_stair_there_is_the_floor_of_the_storey_and_no_slope() -> None:
    floor, rng = stairwell(), np.random.default_rng(0)
    beside = np.column_stack([rng.uniform(2.5, 7, 300), rng.uniform(1.11, 1.6, 300)])
    for z, height in ((1.3, 0.0), (4.3, 3.0), (2.3, 0.0)):
        found = floor.height_at(np.column_stack([beside, np.full(300, z)]))
        assert np.isin(np.round(found, 4), [0.0, 3.0]).all() and (np.abs(found - height) < 1e-6).mean() > 0.9
    below = np.column_stack([np.full(50, 1.9), np.linspace(-1, 2, 50), np.full(50, 1.3)])
    assert np.abs(floor.height_at(below)).max() < 0.1, "before the first step nothing is as high as between the floors"
