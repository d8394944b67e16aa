"""The building without its ceilings, against the submap models it is made of."""

from __future__ import annotations

from pathlib import Path

import demo_project
import demo_room
import numpy as np
import pytest

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.project.project import Project
from nvsim.splats.types import FloorTexture, SubmapModel
from nvsim_app.drawing.cutaway import CUT, REACH, Cutaway, floor_colors


@pytest.fixture
def cutaway(tmp_path: Path) -> Cutaway:
    with Project.open(demo_project.write_project(tmp_path / "demo.nvsim", count=2000, models=3)) as project:
        return Cutaway(project.scene(), project.submaps())


def test_what_is_higher_than_the_cut_is_gone_and_the_rest_is_one_building(cutaway: Cutaway) -> None:
    g = cutaway.model.gaussians
    assert 500 < len(g) < 3 * 2000 and g.means[:, 2].max() < CUT
    # Every place is drawn by one submap only: about as many as one model holds below the cut.
    one = demo_project.gaussians(2000, 0)
    below = int((one.means[:, 2] < CUT).sum())
    assert abs(len(g) - below) < 0.15 * below


def test_the_floor_keeps_its_tiles_and_ends_where_nobody_went(cutaway: Cutaway) -> None:
    xy = np.random.default_rng(0).uniform((1, 1), (demo_room.WIDTH - 1, demo_room.DEPTH - 1), (200, 2))
    source = SubmapModel(demo_project.gaussians(10), None, demo_project.floor_texture(), FloorSurface.flat(0.0))
    made = floor_colors(cutaway.model, xy, np.zeros(3))
    assert np.abs(made - floor_colors(source, xy, np.zeros(3))).mean() < 0.01
    away = floor_colors(cutaway.model, np.array([[demo_room.WIDTH + 2 * REACH, 4.0]]), np.zeros(3))
    assert away.max() < 0.2


def test_texels_are_read_at_their_centers() -> None:
    level = np.arange(12, dtype=np.float32).reshape(2, 2, 3)
    model = SubmapModel(
        demo_project.gaussians(10), None, FloorTexture((level,), (0.0, 0.0), (2.0, 2.0)), FloorSurface.flat(0.0)
    )
    at = np.array([[0.5, 0.5], [1.5, 0.5], [1.0, 1.0]])
    assert np.allclose(floor_colors(model, at, np.zeros(3)), [level[0, 0], level[0, 1], level.mean(axis=(0, 1))])


def test_an_eye_in_a_room_is_inside_and_one_above_the_roof_outside(cutaway: Cutaway) -> None:
    assert not cutaway.is_outside(np.array([7.0, 7.0, 1.7]))
    assert cutaway.is_outside(np.array([7.0, 7.0, 4.0]))


def test_floor_that_no_image_shows_is_not_drawn(tmp_path: Path) -> None:
    with Project.open(demo_project.write_project(tmp_path / "demo.nvsim", count=500, models=1)) as project:
        cutaway = Cutaway(project.scene(), project.submaps(), lambda xy: xy[..., 0] > 7.0)
    seen, unseen = floor_colors(cutaway.model, np.array([[10.0, 4.5], [4.0, 7.5]]), np.zeros(3))
    assert seen.max() > 0.3 and unseen.max() < 0.2
