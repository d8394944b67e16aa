"""Floor that no image shows is floor if the trajectory crosses it."""

import numpy as np
import pytest

from nvsim.capture.types import Cloud
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface, StackedFloor
from nvsim.perception.stacked_support import StackedSupport, is_stacked
from nvsim.perception.support import FloorSupport, observe, positions_at_common_heights


def test_the_walk_supports_the_ground_around_it_also_outside_the_old_grid():
    before = FloorSupport(np.zeros((4, 5), bool), (0.0, 0.0), 0.1)
    walk = np.array([[-1.0, 0.2, 1.4], [2.0, -0.7, 1.4]])
    after = before.with_trajectory_floor(walk, radius=0.3)
    x, y = np.meshgrid(np.arange(-2, 3, 0.037), np.arange(-2, 2, 0.037))
    xy = np.stack([x, y], -1)
    distance = np.min([np.hypot(x - p[0], y - p[1]) for p in walk], axis=0)
    assert after.is_supported(xy)[distance < 0.22].all()
    assert not after.is_supported(xy)[distance > 0.38].any()


def test_what_was_supported_stays():
    before = FloorSupport(np.ones((3, 3), bool), (5.0, 5.0), 0.1)
    after = before.with_trajectory_floor(np.array([[0.0, 0.0, 1.0]]))
    xy = np.stack(np.meshgrid(np.arange(5.05, 5.3, 0.1), np.arange(5.05, 5.3, 0.1)), -1)
    assert after.is_supported(xy).all()
    assert not after.is_supported(np.array([2.5, 2.5]))


def test_no_positions_add_no_floor() -> None:
    thin = np.zeros((3, 3), bool)
    thin[0, 0] = True
    before = FloorSupport(np.eye(3, dtype=bool), (5.0, 5.0), 0.1, np.eye(3, dtype=bool), thin)
    assert np.array_equal(before.with_trajectory_floor(np.empty((0, 3))).cells, before.cells & ~thin)


def test_who_leant_over_a_table_did_not_walk_there():
    ground = FloorSurface(np.array([[0.0, 1.0], [0.0, 1.0]], np.float32), (0.0, 0.0), 4.0)  # a ramp along x
    steady = np.array([[x, 1.0, 1.4 + x / 4] for x in np.linspace(0, 4, 9)])
    leaning = np.array([[2.0, 1.5, 1.0 + 0.5], [3.0, 1.5, 1.9 + 0.75]])
    assert np.array_equal(positions_at_common_heights(np.concatenate([steady, leaning]), ground), steady)
    assert positions_at_common_heights(np.empty((0, 3)), ground).shape == (0, 3)
    robot = steady - [0.0, 0.0, 1.0]  # as many cameras at another height are another way of going, not an exception
    assert (
        len(positions_at_common_heights(np.concatenate([steady, robot]), ground)) == 18
        and len(positions_at_common_heights(steady[:1], ground)) == 1
    )


def test_what_the_depth_of_images_shows_standing_under_a_camera_is_no_floor():
    blocked = np.zeros((10, 10), bool)
    blocked[5:, :] = True
    known = np.zeros((10, 10), bool)
    known[9, 9] = True  # floor that was seen stays
    after = FloorSupport(known, (0.0, 0.0), 0.1, blocked).with_trajectory_floor(np.array([[0.5, 0.5, 1.4]]), radius=0.3)
    assert (
        after.is_supported(np.array([0.5, 0.35]))
        and not after.is_supported(np.array([0.5, 0.65]))
        and after.is_supported(np.array([0.95, 0.95]))
    )


def crossed(standing: slice, walk: np.ndarray, thin: slice | None = None) -> FloorSupport:
    """Floor of 4 by 2 meters that the depth of images shows something on, after a walk."""
    known, blocked, bar = (np.zeros((20, 40), bool) for _ in range(3))
    blocked[:, standing] = True
    if thin is not None:
        bar[:, thin] = True
    known[:] = ~blocked & ~bar
    return FloorSupport(known, (0.0, 0.0), 0.1, blocked, bar).with_trajectory_floor(walk)


def test_who_walked_through_what_images_show_across_a_door_walked_over_floor():
    walk = np.column_stack([np.arange(0.25, 3.9, 0.3), np.full(13, 1.05), np.full(13, 1.4)])
    door = np.array([2.05, 1.05]), np.array([2.05, 1.35]), np.array([2.05, 0.2])
    assert [bool(crossed(slice(20, 23), walk).is_supported(place)) for place in door] == [True, True, False], (
        "an open door"
    )
    assert not crossed(slice(20, 28), walk).is_supported(door[0]), (
        "a table is longer than a step: a hand reached over it"
    )
    assert not crossed(slice(20, 40), walk).is_supported(door[0]), "who did not come out of it did not walk through it"
    assert not crossed(slice(20, 20), walk, slice(20, 22)).is_supported(door[0]), "a bar is stepped over"
    far = walk[[0, -1]]
    assert not crossed(slice(20, 23), far).is_supported(door[0]), (
        "nobody knows how the camera got from one to the other"
    )


def test_a_wall_that_images_continue_across_the_foot_of_a_door_is_no_wall():
    x, y = np.meshgrid(np.arange(0.01, 2, 0.02), np.arange(0.01, 1, 0.02))
    floor = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    across = np.arange(0.01, 1, 0.02)

    def strip(z: float) -> np.ndarray:
        return np.column_stack([np.full(len(across), 1.02), across, np.full(len(across), z)])

    camera = Camera(Intrinsics(64, 48, 40.0, 40.0, 32.0, 24.0), camera_pose(np.array([0.2, 0.5, 1.4]), 90.0, -60.0))
    for z, kind, open_ in ((0.11, "guessed", True), (0.13, "guessed", False), (0.11, "measured", False)):
        points = np.concatenate([floor, *[strip(z)] * 3]).astype(np.float32)
        normals = np.tile(np.float32([0, 0, 1]), (len(points), 1)) if kind == "guessed" else None
        cloud = Cloud(points, None, "scan", normals)
        assert cloud.is_estimated.any() == (kind == "guessed")
        known = observe([camera], [np.zeros((48, 64), bool)], FloorSurface.flat(0.0), cloud)
        assert bool(known.is_supported(np.array([1.02, 0.5]))) == open_, (z, kind)


def test_a_cloud_in_many_blocks_supports_the_same_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform([-20, -3, -0.1], [20, 3, 0.4], (20000, 3)).astype(np.float32)
    normals = np.where(rng.random((20000, 1)) < 0.6, np.float32([0, 0, 1]), np.float32(0))
    camera = Camera(Intrinsics(64, 48, 40.0, 40.0, 32.0, 24.0), camera_pose(np.array([0.2, 0.5, 1.4]), 90.0, -60.0))

    def found() -> FloorSupport:
        cloud = Cloud(points, None, "images", normals)
        return observe([camera], [np.zeros((48, 64), bool)], FloorSurface.flat(0.0), cloud)

    whole = found()
    assert whole.cells.any() and not whole.cells.all() and whole.blocked is not None and whole.blocked.any()
    monkeypatch.setattr("nvsim.perception.support._BLOCK", 700)
    blocks = found()
    assert blocks.origin == whole.origin
    assert np.array_equal(blocks.cells, whole.cells) and np.array_equal(blocks.blocked, whole.blocked)


def test_each_storey_has_its_own_known_floor(tmp_path) -> None:
    floor = StackedFloor((FloorSurface.flat(0.0), FloorSurface.flat(3.0)))
    lower, upper = np.zeros((4, 5), bool), np.zeros((6, 3), bool)
    lower[1, 2] = upper[5, 0] = True
    support = StackedSupport(floor, (FloorSupport(lower, (0.0, 0.0), 0.1), FloorSupport(upper, (-1.0, 2.0), 0.1)))
    points = np.array([[0.25, 0.15, 1.3], [0.25, 0.15, 4.3], [-0.95, 2.55, 1.3], [-0.95, 2.55, 4.3], [99, 99, 4.3]])
    assert support.is_supported(points).tolist() == [True, False, False, True, False]
    assert support.is_supported(points[:, :2]).tolist() == [True, True, False, False, False], (
        "without a height the lowest"
    )
    assert support.is_supported(points.reshape(5, 1, 3)).shape == (5, 1) and support.area == pytest.approx(0.02)
    path = tmp_path / "support.npz"
    support.save(path)
    again = StackedSupport.load(path, floor)
    assert (
        is_stacked(path)
        and np.array_equal(again.is_supported(points), support.is_supported(points))
        and again.area == support.area
    )
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
    assert np.array_equal(support.is_supported(points), support.is_supported(points[:, :2]))
