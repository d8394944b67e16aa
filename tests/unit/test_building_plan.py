"""The plan, the walk and the furniture of the built-in building, before anything is rendered."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from nvsim.building.config import BuildingConfig
from nvsim.building.scene import Scene, make_scene
from nvsim.building.truth import occupancy
from nvsim.occupancy.types import FREE, OCCUPIED

SEEDS = (0, 1, 2, 3, 11)


@pytest.fixture(scope="module", params=SEEDS)
def full(request: pytest.FixtureRequest) -> Scene:
    return make_scene(BuildingConfig(seed=request.param))


def test_about_300_square_meters_in_at_least_six_rooms(full: Scene) -> None:
    assert full.plan.extent.area == pytest.approx(300, rel=0.02)
    assert sum(r.kind != "corridor" for r in full.plan.rooms) >= 6
    assert sum(q.area for r in full.plan.rooms for q in r.rects) == pytest.approx(full.plan.extent.area, rel=1e-6)


def test_corridors_close_a_loop_about_the_core(full: Scene) -> None:
    grid = occupancy(full)
    x, y = np.moveaxis(grid.centers(), -1, 0)
    corridor = next(r for r in full.plan.rooms if r.kind == "corridor")
    ring = np.zeros(grid.cells.shape, bool)
    for r in corridor.rects:
        ring |= (x > r.x0) & (x < r.x1) & (y > r.y0) & (y < r.y1) & (grid.cells == FREE)
    regions, _ = ndimage.label(~ring, structure=np.ones((3, 3)))
    core = next(r for r in full.plan.rooms if r.name == "core").rects[0].center
    row, column = grid.index(np.array(core))
    assert regions[row, column] not in (0, regions[0, 0])


def test_the_walk_goes_around_the_loop_both_ways(full: Scene) -> None:
    core = next(r for r in full.plan.rooms if r.name == "core").rects[0].center
    corridor = next(r for r in full.plan.rooms if r.kind == "corridor")
    inside = np.array([corridor.contains(x, y) for x, y in full.path[:, :2]])
    angle = np.unwrap(np.arctan2(full.path[:, 1] - core[1], full.path[:, 0] - core[0]))
    step = np.where(inside[1:] & inside[:-1], np.diff(angle), 0)
    forth, back = np.degrees(step[step > 0].sum()), np.degrees(-step[step < 0].sum())
    assert min(forth, back) > 280


def test_the_walk_visits_every_room(full: Scene) -> None:
    for room in full.plan.rooms:
        assert sum(room.contains(x, y) for x, y in full.walk[:, :2]) >= 15


def test_the_walk_keeps_its_clearance_in_free_space(full: Scene) -> None:
    grid = occupancy(full)
    assert (grid.states_at(full.path[:, :2]) == FREE).all()
    clearance = ndimage.distance_transform_edt(grid.cells != OCCUPIED) * grid.resolution
    row, column = np.moveaxis(grid.index(full.path[:, :2]), -1, 0)
    assert clearance[row, column].min() >= 0.3


def test_consecutive_images_are_close(full: Scene) -> None:
    assert 380 <= len(full.walk) <= 450
    assert np.linalg.norm(np.diff(full.walk[:, :2], axis=0), axis=1).max() < 0.42
    assert np.degrees(np.abs(np.diff(full.walk[:, 2]))).max() < 17


def test_furniture_has_several_heights_and_there_is_a_step_and_glass(full: Scene) -> None:
    tops = {round(b.hi[2], 2) for b in full.boxes}
    assert {0.15, 0.40, 0.74} <= tops
    assert any(1.5 < t < 2.2 for t in tops)
    glass = [b for b in full.boxes if b.glass]
    assert len(glass) == 1 and glass[0].lo[2] == 0 and glass[0].hi[2] == full.solids.levels[0, 1]


def test_doors_are_as_wide_as_doors(full: Scene) -> None:
    widths = [o.width for o in full.plan.openings if o.framed]
    assert min(widths) >= 0.95 and max(widths) <= 1.1
    assert any(o.width > 1.25 for o in full.plan.openings)


def test_people_stand_in_some_frames_only_and_off_the_way(full: Scene) -> None:
    present = np.array([len(full.people_in_frame(f)[0]) > 0 for f in range(len(full.walk))])
    assert 0.03 < present.mean() < 0.2
    for person in full.people:
        near = np.hypot(*(full.walk[person.first : person.last + 1, :2] - person.capsules[2, :2]).T)
        assert near.min() > 0.8


def test_seeds_differ() -> None:
    a, b = make_scene(BuildingConfig(seed=0)), make_scene(BuildingConfig(seed=1))
    assert a.plan != b.plan and a.boxes != b.boxes
    assert a.plan == make_scene(BuildingConfig(seed=0)).plan
