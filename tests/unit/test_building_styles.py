"""Buildings of glass and of bare walls."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.building import BuildingConfig
from nvsim.building.generation import scan
from nvsim.building.rendering import render
from nvsim.building.scene import Scene, make_scene, textures_of
from nvsim.building.truth import floor_mask, occupancy
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.occupancy.types import OCCUPIED

NOBODY = np.empty((0, 5)), np.empty((0, 3))


@pytest.fixture(scope="module")
def glass() -> Scene:
    return make_scene(BuildingConfig(seed=1, size="small", style="glass"))


def screens(scene: Scene) -> list[int]:
    """Which boxes are panes that stand free in a room."""
    return [i for i, b in enumerate(scene.boxes) if b.glass and b.hi[2] == 1.8]


def test_panes_stand_in_the_way_and_the_scanner_looks_through_them(glass: Scene) -> None:
    grid, points = occupancy(glass), scan(glass, textures_of(glass), np.random.default_rng(0)).points
    panes = [b for b in glass.boxes if b.glass]
    assert len(screens(glass)) == 2 and len(panes) >= 5
    for pane in panes:
        lo, hi = np.array(pane.lo), np.array(pane.hi)
        if lo[2] < 1:
            assert grid.states_at((lo + hi)[:2] / 2) == OCCUPIED
        middle = lo + 0.2 * (hi - lo), hi - 0.2 * (hi - lo)
        thick = np.where(hi - lo < 0.03, 0.03, 0.0)
        assert not ((points > middle[0] - thick) & (points < middle[1] + thick)).all(axis=1).any()
    beyond = sum(occupancy(glass).states_at(points[:, :2]) == OCCUPIED)
    assert beyond > 1000, "walls and furniture are in the scan"


def test_a_pane_shows_what_is_behind_it_and_faintly_what_is_before_it(glass: Scene) -> None:
    pane = glass.boxes[screens(glass)[0]]
    lo, hi = np.array(pane.lo), np.array(pane.hi)
    normal = np.array([1.0, 0.0]) if hi[0] - lo[0] < hi[1] - lo[1] else np.array([0.0, 1.0])
    middle = (lo + hi)[:2] / 2
    extent = np.array([glass.plan.extent.x1, glass.plan.extent.y1])
    places = [middle + s * 1.1 * normal for s in (1, -1)]
    place = next(p for p in places if (p > 0.4).all() and (p < extent - 0.4).all())
    heading = float(np.arctan2(*(middle - place)))
    camera = Camera(Intrinsics.from_fov(120, 90, np.radians(60)), camera_pose(np.array([*place, 1.3]), heading, -0.2))
    textures = textures_of(glass)
    seen = render(camera, glass.solids, textures, *NOBODY)
    without = glass.solids._replace(glass=np.zeros_like(glass.solids.glass), hi=glass.solids.hi.copy())
    without.hi[screens(glass)] = without.lo[screens(glass)] - 1e-3  # boxes that no ray meets
    without = without._replace(glass=glass.solids.glass)
    clear = render(camera, without, textures, *NOBODY)
    assert np.array_equal(seen.surface, clear.surface) and np.allclose(seen.depth, clear.depth)
    assert np.array_equal(floor_mask(glass, seen), floor_mask(glass, clear))
    difference = np.abs(seen.color - clear.color).max(axis=-1)
    through = difference > 1e-4
    assert 0.2 < through.mean() < 1 and 0.01 < difference[through].mean() < 0.12
    tinted = clear.color * np.array([0.93, 0.96, 0.95], np.float32)
    assert np.abs(seen.color - tinted)[through].max() > 0.02, "a reflection lies over the tint"


def test_bare_rooms_have_plain_walls_and_little_in_them() -> None:
    bare, furnished = (make_scene(BuildingConfig(seed=1, style=s)) for s in ("bare", "furnished"))
    assert len(bare.boxes) < len(furnished.boxes) / 2
    assert np.array_equal(bare.walk, furnished.walk) and bare.plan == furnished.plan
    paints = {p.kind for b in bare.boxes for _, p in b.faces if p.kind.startswith("wall")}
    assert paints == {"wall-bare"}
    textures = textures_of(bare)
    wall = max(
        range(len(bare.boxes)),
        key=lambda i: (bare.boxes[i].hi[2] > 2.6, max(np.subtract(bare.boxes[i].hi, bare.boxes[i].lo)[:2])),
    )
    faces = [6 * wall + f for f, p in bare.boxes[wall].faces if p.kind == "wall-bare"]
    start, rows, columns = textures.chain[faces[0], 0]
    image = textures.texels[start : start + rows * columns].reshape(rows, columns, 3).astype(float)
    steps = np.abs(np.diff(image[rows // 8 :], axis=1)).max()
    assert steps < 8, "light alone changes along the wall"
