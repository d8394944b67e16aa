"""What nobody looked down at, but somebody walked over, is floor."""

import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.stacked_floor import StackedFloor
from nvsim.perception.stacked_support import StackedSupport, is_stacked
from nvsim.perception.support import FloorSupport, walked


def test_the_walk_supports_the_ground_around_it_also_outside_the_old_grid():
    before = FloorSupport(np.zeros((4, 5), bool), (0.0, 0.0), 0.1)
    walk = np.array([[-1.0, 0.2, 1.4], [2.0, -0.7, 1.4]])
    after = before.trodden(walk, radius=0.3)
    x, y = np.meshgrid(np.arange(-2, 3, 0.037), np.arange(-2, 2, 0.037))
    xy = np.stack([x, y], -1)
    distance = np.min([np.hypot(x - p[0], y - p[1]) for p in walk], axis=0)
    assert after.at(xy)[distance < 0.22].all()
    assert not after.at(xy)[distance > 0.38].any()


def test_what_was_supported_stays():
    before = FloorSupport(np.ones((3, 3), bool), (5.0, 5.0), 0.1)
    after = before.trodden(np.array([[0.0, 0.0, 1.0]]))
    xy = np.stack(np.meshgrid(np.arange(5.05, 5.3, 0.1), np.arange(5.05, 5.3, 0.1)), -1)
    assert after.at(xy).all()
    assert not after.at(np.array([2.5, 2.5]))


def test_who_leant_over_a_table_did_not_walk_there():
    ground = FloorSurface(np.array([[0.0, 1.0], [0.0, 1.0]], np.float32), (0.0, 0.0), 4.0)  # a ramp along x
    steady = np.array([[x, 1.0, 1.4 + x / 4] for x in np.linspace(0, 4, 9)])
    leaning = np.array([[2.0, 1.5, 1.0 + 0.5], [3.0, 1.5, 1.9 + 0.75]])
    assert np.array_equal(walked(np.concatenate([steady, leaning]), ground), steady)
    assert walked(np.empty((0, 3)), ground).shape == (0, 3)
    robot = steady - [0.0, 0.0, 1.0]  # as many cameras at another height are another way of going, not an exception
    assert len(walked(np.concatenate([steady, robot]), ground)) == 18 and len(walked(steady[:1], ground)) == 1


def test_what_the_depth_of_images_shows_standing_under_a_camera_is_no_floor():
    blocked = np.zeros((10, 10), bool)
    blocked[5:, :] = True
    known = np.zeros((10, 10), bool)
    known[9, 9] = True  # floor that was seen stays
    after = FloorSupport(known, (0.0, 0.0), 0.1, blocked).trodden(np.array([[0.5, 0.5, 1.4]]), radius=0.3)
    assert after.at(np.array([0.5, 0.35])) and not after.at(np.array([0.5, 0.65])) and after.at(np.array([0.95, 0.95]))


def test_each_storey_has_its_own_known_floor(tmp_path) -> None:
    floor = StackedFloor((FloorSurface.flat(0.0), FloorSurface.flat(3.0)))
    lower, upper = np.zeros((4, 5), bool), np.zeros((6, 3), bool)
    lower[1, 2] = upper[5, 0] = True
    support = StackedSupport(floor, (FloorSupport(lower, (0.0, 0.0), 0.1), FloorSupport(upper, (-1.0, 2.0), 0.1)))
    points = np.array([[0.25, 0.15, 1.3], [0.25, 0.15, 4.3], [-0.95, 2.55, 1.3], [-0.95, 2.55, 4.3], [99, 99, 4.3]])
    assert support.at(points).tolist() == [True, False, False, True, False]
    assert support.at(points[:, :2]).tolist() == [True, True, False, False, False], "without a height the lowest"
    assert support.at(points.reshape(5, 1, 3)).shape == (5, 1) and support.area == pytest.approx(0.02)
    path = tmp_path / "support.npz"
    support.save(path)
    again = StackedSupport.load(path, floor)
    assert is_stacked(path) and np.array_equal(again.at(points), support.at(points)) and again.area == support.area
    with pytest.raises(InputError, match="nvsim floors"):
        StackedSupport.load(path, FloorSurface.flat(0.0))
    with pytest.raises(InputError, match="nvsim floors"):
        FloorSupport.load(path)
    FloorSupport(lower, (0.0, 0.0), 0.1).save(path)
    assert not is_stacked(path) and not is_stacked(tmp_path / "missing.npz")
    with pytest.raises(InputError, match="nvsim floors"):
        StackedSupport.load(path, floor)
    path.write_bytes(b"PK damaged")
    assert not is_stacked(path)


def test_one_floor_knows_of_points_what_it_knows_of_places() -> None:
    support = FloorSupport(np.random.default_rng(0).random((7, 9)) > 0.5, (-1.5, 2.0), 0.3)
    points = np.random.default_rng(1).uniform(-3, 6, (100, 3))
    assert np.array_equal(support.at(points), support.at(points[:, :2]))
