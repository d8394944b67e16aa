"""Submap colors against the nearest core camera, worked out pixel by pixel."""

from __future__ import annotations

import demo_room
import numpy as np
import pytest

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.types import SubmapModel
from nvsim_app.drawing.painter import CELL, SubmapGrid, _by_kernels
from nvsim_app.look import colors
from nvsim_app.painting.cameras import ViewPose


@pytest.fixture(scope="module")
def submaps():
    return demo_room.submaps(demo_room.capture())


def nearest(submaps, x: float, y: float) -> tuple[int, float]:
    """The submap, and by how many meters it is nearer than the second."""
    distances = sorted((np.linalg.norm(s.positions[:, :2] - (x, y), axis=1).min(), s.index) for s in submaps)
    return distances[0][1], distances[1][0] - distances[0][0]


def test_the_nearest_submap_owns_a_place(submaps) -> None:
    territory = SubmapGrid(submaps)
    places = np.random.default_rng(1).uniform((0, 0), (demo_room.WIDTH, demo_room.DEPTH), (300, 2))
    for place, owner in zip(places, territory.owner_at(places), strict=True):
        expected, margin = nearest(submaps, *place)
        assert owner == expected or margin < 2 * CELL


def test_nobody_owns_what_is_far_away_or_unknown(submaps) -> None:
    places = np.array([[500.0, 0.0], [np.nan, 1.0], [-40.0, 2.0]])
    assert SubmapGrid(submaps).owner_at(places).tolist() == [-1, -1, -1]


def test_the_floor_is_in_the_color_of_the_submap_that_stands_on_it(submaps) -> None:
    from demo_project import floor_texture, gaussians

    model = SubmapModel(gaussians(4000), None, floor_texture(), FloorSurface.flat(0.0))
    x, y, _ = submaps[1].positions[len(submaps[1].positions) // 2]
    camera = ViewPose((x, y, 1.5), elevation=-1.4).camera(64, 48)
    picture = _by_kernels(model, camera, "submap", SubmapGrid(submaps))
    direction = camera.rays()[24, 32].astype(float)
    place = camera.position + direction * (camera.position[2] / -direction[2])
    owner, _ = nearest(submaps, *place[:2])
    assert owner == 1
    tint = np.array([int(colors.submap_color(owner)[i : i + 2], 16) for i in (1, 3, 5)], float)
    color = picture[24, 32, 2::-1].astype(float)
    assert np.corrcoef(color - color.mean(), tint - tint.mean())[0, 1] > 0.99


def test_without_a_background_the_floor_is_a_hole() -> None:
    from demo_project import floor_texture, gaussians

    model = SubmapModel(gaussians(4000), None, floor_texture(), FloorSurface.flat(0.0))
    camera = ViewPose((7.0, 4.5, 1.5), elevation=-1.2).camera(64, 48)
    assert _by_kernels(model, camera, "hole")[40, 32, :3].tolist() == [180, 64, 255]
