"""Which cameras are on which storey, and that submaps keep storeys apart."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from nvsim.building import BuildingConfig
from nvsim.building.scene import CAMERA_HEIGHT, make_scene
from nvsim.submaps.split import SubmapConfig, split, storeys_of


def round_trip(z: float, x: float = 0.0, count: int = 60) -> NDArray[np.float64]:
    """Cameras around a room of 6 x 4 m."""
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.column_stack([x + 3 + 3 * np.cos(t), 2 + 2 * np.sin(t), np.full(count, z)])


def climb(low: float, high: float, count: int = 12) -> NDArray[np.float64]:
    s = np.linspace(0, 1, count + 2)[1:-1, None]
    return np.array([0.0, 5.0, low]) * (1 - s) + np.array([5.0, 5.0, high]) * s


@pytest.mark.parametrize("storeys", [2, 3, 4])
def test_every_camera_is_on_its_storey_or_its_stair(storeys: int) -> None:
    parts, rows = [], []
    for k in range(storeys):
        rows.append(round_trip(1.3 + 2.9 * k))
        parts += [2 * k] * 60
        if k + 1 < storeys:
            rows.append(climb(1.3 + 2.9 * k, 4.2 + 2.9 * k))
            parts += [2 * k + 1] * 12
    found = storeys_of(np.concatenate(rows))
    np.testing.assert_allclose(found.levels, 1.3 + 2.9 * np.arange(storeys), atol=0.05)
    wrong = found.part != parts
    assert wrong.sum() <= 2 * (storeys - 1), "the first and the last step are as good as the floor"
    assert (
        found.cameras_of_storey(0).sum() >= 70
        and found.cameras_of_storey(1).sum() > found.cameras_of_storey(0).sum() - 1
    )
    assert found.nearest(np.array([0.0, 1.3, 4.0])).tolist() == [0, 0, 1]


def test_what_does_not_lie_over_one_another_is_one_storey() -> None:
    rng = np.random.default_rng(0)
    hill = np.column_stack([np.linspace(0, 60, 300), rng.normal(0, 0.3, 300), 1.3 + np.linspace(0, 9, 300)])
    away = climb(1.3, 4.3) * [1.2, 0, 1] + [5.5, 2, 0]
    beside = np.concatenate([round_trip(1.3), away, round_trip(4.3, x=12.0)])
    raised = np.concatenate([round_trip(1.3), round_trip(2.4), round_trip(0.5)])
    scattered = rng.normal(0, 5, (200, 3))
    for walk in (hill, beside, raised, scattered, round_trip(1.3), round_trip(1.3)[:1], np.empty((0, 3))):
        found = storeys_of(walk)
        assert len(found.levels) == 1 and not found.part.any() and len(found.part) == len(walk)
    assert len(storeys_of(np.concatenate([round_trip(1.3), round_trip(4.3, x=4.0)])).levels) == 2


def test_a_camera_that_is_held_up_stays_on_its_storey() -> None:
    walk = np.concatenate([round_trip(1.3), climb(1.3, 4.3), round_trip(4.3)])
    walk[[5, 20]] += [0, 0, 0.25]
    found = storeys_of(walk)
    assert found.part[[5, 20]].tolist() == [0, 0] and len(np.unique(found.part)) == 3


@pytest.mark.parametrize("size", ["small", "full"])
def test_submaps_of_a_building_keep_to_one_storey_or_its_stair(size: str) -> None:
    scene = make_scene(BuildingConfig(seed=4, size=size, storeys=2))  # type: ignore[arg-type]
    walk = np.column_stack([scene.walk[:, :2], scene.walk[:, 3] + CAMERA_HEIGHT])
    part = storeys_of(walk).part
    assert (np.abs(scene.walk[part == 0, 3]) <= 0.3 + 1e-6).all() and (scene.walk[part == 2, 3] >= 2.7 - 1e-6).all()
    for config in (SubmapConfig(), SubmapConfig(count=9)):
        submaps = split(walk, config)
        assert len(submaps) >= 3 and all(len(np.unique(part[list(s.core)])) == 1 for s in submaps)
        assert sorted(f for s in submaps for f in s.core) == list(range(len(walk)))
    flat = walk * [1, 1, 0]
    assert len(split(flat, SubmapConfig(count=2))) == len(split(walk, SubmapConfig(count=2))) == 2


def test_the_submap_of_a_storey_has_the_frames_of_a_stair_as_far_as_a_corridor_reaches() -> None:
    walk = np.concatenate([round_trip(1.3), climb(1.3, 4.3), round_trip(4.3)])
    part = storeys_of(walk).part
    for s in split(walk, SubmapConfig(overlap=1.0)):
        distance = np.linalg.norm(walk[:, None] - walk[list(s.core)], axis=-1).min(axis=1)
        assert set(s.frames) == {*s.core, *np.flatnonzero(distance <= np.where(part == 1, 3.5, 1.0))}


def test_three_thousand_cameras_are_cut_along_their_storeys_too() -> None:
    walk = np.concatenate([round_trip(1.3, count=1700), climb(1.3, 4.3, 60), round_trip(4.3, count=1700)])
    part = storeys_of(walk).part
    assert all(len(np.unique(part[list(s.core)])) == 1 for s in split(walk))
