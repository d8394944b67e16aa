"""Buildings of two storeys: the stair against its closed form, rays against all boxes, one map for each storey."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from nvsim.building import BuildingConfig, generate
from nvsim.building.plan import GOING, LENGTH, RISERS
from nvsim.building.raycast import NOTHING, trace
from nvsim.building.rendering import render
from nvsim.building.scene import CAMERA_HEIGHT, Scene, make_scene, textures_of
from nvsim.building.truth import floor_mask, true_occupancy
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.occupancy.ros import read_ros_map
from nvsim.occupancy.storeys import read_storeys
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN

SEEDS = (0, 1, 2, 5)
RISE = 3.0 / 18
NOBODY = np.empty((0, 5))
TINY = BuildingConfig(seed=1, size="small", width=48, height=36, storeys=2)


@pytest.fixture(scope="module", params=SEEDS)
def house(request: pytest.FixtureRequest) -> Scene:
    return make_scene(BuildingConfig(seed=request.param, size="small", storeys=2))


def below(scene: Scene, xyz: NDArray[np.float64]) -> float:
    """Meters straight down from a position to the next surface."""
    return float(trace(*xyz, 0.0, 0.0, -1.0, scene.solids, NOBODY)[0])


def fingerprint(*arrays: NDArray[np.generic]) -> str:
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()[:16]


def test_a_building_of_one_storey_is_the_one_of_before() -> None:
    scene = make_scene(BuildingConfig(seed=3, size="small"))
    assert fingerprint(scene.solids.lo) == "ee1f1adc453982c9"
    assert fingerprint(scene.walk[:, :3]) == "f564ed6a62547d58"
    assert fingerprint(true_occupancy(scene).storeys[0].occupancy.cells) == "552a445a2e8e6465"
    assert fingerprint(make_scene(BuildingConfig(seed=1)).solids.hi) == "a25ac7d11d996437"


def test_steps_are_as_high_and_as_deep_as_steps(house: Scene) -> None:
    flight = house.plan.flight
    assert flight is not None
    assert flight.width >= 1.0 and pytest.approx(RISE) == flight.rise and 0.16 < RISE < 0.18
    across = np.array([-flight.direction[1], flight.direction[0]])
    for i in range(RISERS - 1):
        for side in (-0.45, 0.0, 0.45):
            spot = flight.foot + (i + 0.5) * GOING * flight.direction + side * flight.width * across
            assert below(house, np.array([*spot, 4.5])) == pytest.approx(4.5 - (i + 1) * RISE, abs=1e-9)
    before, behind = flight.foot - 0.01 * flight.direction, np.array(flight.head) + 0.01 * flight.direction
    assert below(house, np.array([*before, 2.0])) == pytest.approx(2.0), "the lower floor begins before the first riser"
    assert below(house, np.array([*behind, 4.5])) == pytest.approx(1.5), "the upper floor behind the last"
    treads = flight.treads()
    assert all(a.overlaps(b) is False for (a, _), (b, _) in zip(treads[:-1], treads[1:]))


def test_the_floor_above_is_open_over_the_stair_alone(house: Scene) -> None:
    flight = house.plan.flight
    assert flight is not None
    hole, extent = flight.rect, house.plan.extent
    rng = np.random.default_rng(0)
    places = rng.uniform((0.3, 0.3), (extent.x1 - 0.3, extent.y1 - 0.3), (400, 2))
    for x, y in places:
        t, surface, _ = trace(x, y, 2.699, 0.0, 0.0, 1.0, house.solids, NOBODY)
        if hole.contains(x, y):
            assert t == pytest.approx(5.7 - 2.699)
        elif surface == house.floor_surface + 1:
            assert t == pytest.approx(0.001)
    assert any(hole.contains(x, y) for x, y in places)


def test_rays_meet_what_they_meet_without_a_grid(house: Scene) -> None:
    """Every ray against every box and plane, one after another."""
    lo, hi, solid = house.solids.lo, house.solids.hi, ~house.solids.glass
    hole = house.solids.void
    rng = np.random.default_rng(1)
    met = set()
    for origin in house.walk[rng.integers(0, len(house.walk), 25)]:
        eye = np.array([origin[0], origin[1], origin[3] + CAMERA_HEIGHT])
        for d in rng.normal(size=(25, 3)):
            d /= np.linalg.norm(d)
            a, b = (lo - eye) / d, (hi - eye) / d
            near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
            hits = near[(near <= far) & (near > 1e-6) & solid].tolist()
            for k, (floor, ceiling) in enumerate(house.solids.levels):
                t = ((floor if d[2] < 0 else ceiling) - eye[2]) / d[2]
                x, y = eye[:2] + t * d[:2]
                inner = k == 1 if d[2] < 0 else k == 0
                if t > 0 and not (inner and hole[0] < x < hole[2] and hole[1] < y < hole[3]):
                    hits.append(t)
            t, surface, _ = trace(*eye, *d, house.solids, NOBODY)
            assert surface != NOTHING and t == pytest.approx(min(hits), abs=1e-9)
            met.add(int(np.sign(eye[2] + t * d[2] - 2.85)))
    assert met == {-1, 1}


def test_the_camera_keeps_its_height_up_and_down(house: Scene) -> None:
    floor = house.walk[:, 3]
    on_stair = (floor > 0) & (floor < 3)
    up = np.flatnonzero(np.diff(floor) > 0)
    down = np.flatnonzero(np.diff(floor) < 0)
    assert len(up) > 8 and len(down) > 8 and up.max() < down.min() and floor[0] == floor[-1] == 0
    for frame in range(len(house.walk)):
        position = house.camera(frame).position
        height = below(house, position)
        assert abs(height - CAMERA_HEIGHT) <= (RISE / 2 + 1e-6 if on_stair[frame] else 1e-6)
    steps = np.abs(np.diff(floor)) / np.maximum(np.linalg.norm(np.diff(house.walk[:, :2], axis=0), axis=1), 1e-9)
    assert steps.max() <= RISE / GOING + 1e-3, "no jump between the storeys"
    assert np.abs(house.walk[~on_stair, 4]).max() == 0 and np.degrees(house.walk[down, 4]).min() == pytest.approx(-20)


def test_the_walk_is_free_on_the_map_of_its_storey(house: Scene) -> None:
    for storey in true_occupancy(house).storeys:
        here = house.path[np.abs(house.path[:, 3] - storey.floor) < 1.5]
        assert len(here) > 500 and (storey.occupancy.states_at(here[:, :2]) == FREE).all()


def test_maps_agree_with_the_boxes_of_their_storey(house: Scene) -> None:
    """Cell centers against the column above them, box by box."""
    maps = true_occupancy(house)
    rng = np.random.default_rng(2)
    differs = 0
    for k, storey in enumerate(maps.storeys):
        cells, centers = storey.occupancy.cells, storey.occupancy.centers()
        for r, c in rng.integers((0, 0), cells.shape, (1500, 2)):
            x, y = centers[r, c]
            standing = any(
                b.lo[0] <= x <= b.hi[0] and b.lo[1] <= y <= b.hi[1]
                for b in house.boxes
                if not b.tread and b.lo[2] < storey.floor + 1.5 and b.hi[2] > storey.floor + 0.1
            )
            assert not standing or cells[r, c] == OCCUPIED
            differs += cells[r, c] != maps.storeys[1 - k].occupancy.cells[r, c]
    assert differs > 100, "the storeys are furnished differently"


def test_treads_are_free_on_both_maps_and_the_landings_on_one(house: Scene) -> None:
    flight, maps = house.plan.flight, true_occupancy(house)
    assert flight is not None
    lower, upper = (s.occupancy for s in maps.storeys)
    (stair,) = maps.stairs
    for rect, _ in flight.treads():
        assert lower.states_at(np.array(rect.center)) == upper.states_at(np.array(rect.center)) == FREE
        assert stair.contains(np.array([rect.center])).all()
    before, behind = flight.foot - 0.6 * flight.direction, np.array(flight.head) + 0.6 * flight.direction
    assert lower.states_at(before) == FREE and upper.states_at(before) != FREE
    assert upper.states_at(behind) == FREE and lower.states_at(behind) == UNKNOWN
    assert not stair.contains(np.array([before, behind])).any()


def test_masks_call_steps_floor_treads_and_risers_alike() -> None:
    scene = make_scene(BuildingConfig(seed=0, size="small", storeys=2, people=False, width=160, height=120))
    flight, textures = scene.plan.flight, textures_of(scene)
    assert flight is not None
    spot = flight.foot + (2 * GOING) * flight.direction
    heading = float(np.arctan2(*flight.direction))
    lens = Intrinsics.from_fov(160, 120, np.radians(80))
    seen = set()
    for height, elevation in ((1.6, 0.0), (4.6, -0.6)):
        turn = 0.0 if height < 3 else np.pi
        place = spot if height < 3 else np.array(flight.head)
        camera = Camera(lens, camera_pose(np.array([*place, height]), heading + turn, elevation))
        view = render(camera, scene.solids, textures, NOBODY, np.empty((0, 3)))
        points = camera.position + view.depth[..., None] * (camera.rays() / (camera.rays() @ camera.rotation[:, 2:]))
        mask = floor_mask(scene, view)
        ahead = flight.distance_along(points[..., :2])
        upright = np.abs(ahead / GOING - np.round(ahead / GOING)) < 1e-3
        beside = np.abs((points[..., :2] - flight.foot) @ [flight.direction[1], -flight.direction[0]])
        riser = upright & (ahead > -0.01) & (ahead < LENGTH - 0.01) & (beside < flight.width / 2 - 0.01)
        riser &= (points[..., 2] > 0.02) & (points[..., 2] < (ahead / GOING + 1) * RISE)
        assert mask[riser].all()
        steps = points[mask & ~upright][:, 2] / RISE
        assert np.abs(steps - np.round(steps)).max() < 0.01 and mask.mean() > 0.05
        seen |= set(np.round(steps).astype(int).tolist())
    assert seen >= {0, 3, 4, 5, 6, 12, 14}


def test_both_sizes_climb_in_all_eight_positions() -> None:
    facing = set()
    for seed in range(6):
        scene = make_scene(BuildingConfig(seed=seed, storeys=2))
        flight = scene.plan.flight
        assert flight is not None and scene.storeys[1].plan.flight == flight
        assert scene.plan.extent == scene.storeys[1].plan.extent
        facing.add(tuple(np.round(flight.direction).astype(int)))
        assert (scene.walk[:, 3] == 0).sum() > 350 and (scene.walk[:, 3] == 3).sum() > 350
        room = scene.storeys[1].plan.room_at(*flight.rect.center)
        assert room is not None and room.kind == "stairs"
    assert len(facing) >= 3


def test_the_truth_has_a_map_for_each_storey(tmp_path: Path) -> None:
    generate(tmp_path / "a", TINY)
    generate(tmp_path / "b", TINY)
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert all((tmp_path / "a" / f).read_bytes() == (tmp_path / "b" / f).read_bytes() for f in files)
    truth, scene = tmp_path / "a" / "ground_truth", make_scene(TINY)
    found, expected = read_storeys(truth), true_occupancy(scene)
    assert [s.floor for s in found.storeys] == [0.0, 3.0] and found.stairs == expected.stairs
    for k, (a, b) in enumerate(zip(found.storeys, expected.storeys, strict=True)):
        assert np.array_equal(a.occupancy.cells, b.occupancy.cells)
        assert np.array_equal(read_ros_map(truth / f"storey_{k}" / "map.yaml").cells, b.occupancy.cells)
    assert not (truth / "map.yaml").exists()
    assert len(list((truth / "floor").glob("*.png"))) == len(scene.walk)
    poses = [line.split() for line in (truth / "holdout_frames.txt").read_text().splitlines() if line[0] != "#"]
    assert {float(p[12]) for p in poses} == {CAMERA_HEIGHT, 3.0 + CAMERA_HEIGHT}
    generate(tmp_path / "a", BuildingConfig(seed=1, size="small", width=48, height=36))
    assert (truth / "map.yaml").exists() and not list(truth.glob("storey*/*")) and not (truth / "storeys.json").exists()
