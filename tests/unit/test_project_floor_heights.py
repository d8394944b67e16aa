"""The floor under a viewpoint is that of its own storey."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from nvsim.geometry.floor_surface import FloorSurface, StackedFloor
from nvsim.project.floor_heights import floor_beneath, floor_of, floors_seen
from nvsim.submaps.split import Submap


class House:
    """Two storeys over one another, a submap each, and a shed whose floor nobody estimated."""

    def submaps(self, of: str = "submaps") -> list[Submap]:
        places = np.column_stack([np.arange(5.0), np.zeros(5), np.full(5, 1.5)])
        shifts = ([0, 0, 0], [0, 0, 3], [20, 0, 0])
        return [Submap(i, tuple(range(5)), tuple(range(5)), places + shift) for i, shift in enumerate(shifts)]

    submaps_as_cut = submaps

    def surface(self, submap: int) -> FloorSurface | None:
        return None if submap == 2 else FloorSurface.flat(3.0 * submap)


def test_storeys_stay_apart_and_far_from_the_walk_nothing_is_known() -> None:
    floor = floor_beneath(House())  # type: ignore[arg-type]
    assert floor is not None
    assert floor(2.2, 0.1, 1.4) == 0.0 and floor(2.2, 0.1, 4.4) == 3.0
    assert math.isnan(floor(60.0, 0.0, 1.5))


def test_without_an_estimated_floor_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(House, "surface", lambda self, submap: None)
    assert floor_beneath(House()) is None  # type: ignore[arg-type]


class Villa:
    """Two storeys over one another and the stair between them along x from 0 to 5 at y = 6, a submap each."""

    def submaps(self, of: str = "submaps") -> list[Submap]:
        t = np.linspace(0, 2 * np.pi, 40)
        around = np.column_stack([3 + 3 * np.cos(t), 2 + 2 * np.sin(t), np.full(40, 1.3)])
        s = np.linspace(0.1, 0.9, 10)
        stair = np.column_stack([5 * s, np.full(10, 6.0), 1.3 + 3 * s])
        places = (around, stair, around + [0, 0, 3])
        return [Submap(i, tuple(range(len(p))), tuple(range(len(p))), p) for i, p in enumerate(places)]

    submaps_as_cut = submaps

    def surface(self, submap: int) -> FloorSurface:
        if submap == 1:
            x = np.arange(-3, 9) * 1.0
            return FloorSurface(np.tile(np.clip(0.6 * x, 0, 3), (14, 1)).astype(np.float32), (-3.0, -2.0), 1.0)
        return FloorSurface.flat(1.5 * submap)


def test_the_floor_of_a_villa_is_that_of_the_storey_one_is_on() -> None:
    floor = floor_of(Villa())  # type: ignore[arg-type]
    assert isinstance(floor, StackedFloor) and len(floor.storeys) == 2
    rng = np.random.default_rng(0)
    room = np.column_stack([rng.uniform(-1, 7, 200), rng.uniform(-1, 5.2, 200)])
    for z, height in ((1.3, 0.0), (4.3, 3.0), (0.0, 0.0), (3.0, 3.0)):
        np.testing.assert_allclose(floor.height_at(np.column_stack([room, np.full(200, z)])), height, atol=1e-6)
    assert (floor.height_at(room) == 0).all(), "without a height the lowest"
    for x in np.arange(0.6, 4.6, 0.2):
        for z in (1.3, 0.6 * x, 0.6 * x + 1.3, 4.3):
            assert floor.height_at(np.array([x, 6.1, z])) == pytest.approx(0.6 * x, abs=0.05)
    for z, height in ((1.3, 0.0), (4.3, 3.0)):
        assert floor.height_at(np.array([3.0, 5.2, z])) == height, "behind the wall along the stair"


class Walked(Villa):
    """The villa as a project whose frames are all in the core of their submap."""

    def submaps(self, of: str = "submaps") -> list[Submap]:
        found, first = [], 0
        for s in Villa.submaps(self):
            frames = tuple(range(first, first + len(s.positions)))
            found.append(Submap(s.index, frames, frames, s.positions))
            first += len(frames)
        return found

    submaps_as_cut = submaps

    def need_capture(self) -> SimpleNamespace:
        return SimpleNamespace(positions=np.concatenate([s.positions for s in self.submaps()]))


def test_a_frame_sees_its_storey_with_the_stairs_and_one_on_a_stair_both_storeys() -> None:
    villa = Walked()
    seen = floors_seen(villa)  # type: ignore[arg-type]
    below, stair, above = (s.core for s in villa.submaps())
    assert sorted(seen) == [*below, *stair, *above]
    assert all(len({id(seen[i]) for i in frames}) == 1 for frames in (below, above)), "frames are taken together"
    on, foot, head, room = np.array([2.5, 6.0]), np.array([-1.0, 6.0]), np.array([6.5, 6.0]), np.array([3.0, 1.0])
    for frames, before, behind, far in ((below, 0, 0, 0), (above, 3, 3, 3), (stair[4:6], 0, 3, None)):
        floor = seen[frames[0]]
        assert floor.height_at(on) == pytest.approx(1.5, abs=0.05), "the stair belongs to all"
        assert floor.height_at(foot) == pytest.approx(before, abs=0.05)
        assert floor.height_at(head) == pytest.approx(behind, abs=0.05)
        assert far is None or floor.height_at(room) == pytest.approx(far)


def test_submaps_of_one_storey_are_joined_as_ever() -> None:
    class Bungalow(House):
        def surface(self, submap: int) -> FloorSurface:
            heights = np.random.default_rng(submap).normal(size=(40, 60)).astype(np.float32)
            return FloorSurface(heights, (-10.0, -10.0), 1.0)

        def submaps(self, of: str = "submaps") -> list[Submap]:
            return [House.submaps(self)[0], House.submaps(self)[2]]

        submaps_as_cut = submaps

    house = Bungalow()
    floor = floor_of(house)  # type: ignore[arg-type]
    assert isinstance(floor, FloorSurface) and floor.spacing == 0.5
    places = np.concatenate([s.positions[:, :2] for s in house.submaps()])
    rows, columns = floor.heights.shape
    for r, c in np.random.default_rng(0).integers((0, 0), (rows, columns), (200, 2)):
        xy = np.array(floor.origin) + 0.5 * np.array([c, r])
        owner = (0, 2)[int(cKDTree(places).query(xy)[1] >= 5)]
        assert floor.heights[r, c] == house.surface(owner).height_at(xy)
