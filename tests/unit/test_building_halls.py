"""A large building: shops along halls, all of them entered by a trajectory that touches nothing."""

from __future__ import annotations

import pytest

from nvsim.building.config import BuildingConfig
from nvsim.building.scene import Scene, make_scene
from nvsim.building.truth import occupancy
from nvsim.errors import InputError
from nvsim.occupancy.paths import clearance


@pytest.fixture(scope="module", params=[(300, 0), (1000, 3), (3000, 1)])
def scene(request: pytest.FixtureRequest) -> Scene:
    area, seed = request.param
    return make_scene(BuildingConfig(seed=seed, size="halls", area=area))


def test_it_has_the_area_that_was_asked_for(scene: Scene) -> None:
    assert scene.plan.extent.area == pytest.approx(scene.config.area, rel=0.02)
    rooms = sum(r.area for room in scene.plan.rooms for r in room.rects)
    assert rooms == pytest.approx(scene.plan.extent.area, rel=1e-6), "rooms fill it, and none lies over another"


def test_the_trajectory_enters_every_room_and_keeps_clear_of_all_that_stands(scene: Scene) -> None:
    entered = {room.name for x, y in scene.path[:, :2] if (room := scene.plan.room_at(x, y)) is not None}
    assert entered == {room.name for room in scene.plan.rooms}
    free = clearance(occupancy(scene))
    index = occupancy(scene).index(scene.path[:, :2])
    assert free[index[:, 0], index[:, 1]].min() > 0.25, "the radius of a robot"


def test_images_grow_with_the_area(scene: Scene) -> None:
    assert 0.55 < len(scene.walk) / scene.config.area < 1.1


@pytest.mark.parametrize(
    ("options", "said"),
    [({"area": 100}, "250 to 20000 square meters, not 100"), ({"area": 900, "storeys": 2}, "has one storey")],
)
def test_what_cannot_be_built_is_said(options: dict[str, int], said: str) -> None:
    with pytest.raises(InputError, match=said):
        BuildingConfig(size="halls", **options)  # type: ignore[arg-type]
