"""Floor plans show obstacles and floor in place, from the submap whose camera passed nearest."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.r2r.observations.floor_plan import Frame, draw_plan, storeys_with
from nvsim.splats.files import save_model
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import FloorTexture, Gaussians, SubmapModel
from nvsim.submaps.split import Submap


def ball(x: float, y: float, z: float, color: tuple[float, float, float]) -> Gaussians:
    """A dense ball 20 cm wide."""
    random, f = np.random.default_rng(1), np.float32
    means = (np.array([x, y, z]) + random.normal(0, 0.03, (60, 3))).astype(f)
    sh = np.tile((np.array(color) - 0.5) / 0.28209479177387814, (60, 1, 1)).astype(f)
    scales, quats = np.full((60, 3), np.log(0.04), f), np.tile(np.array([1, 0, 0, 0], f), (60, 1))
    return Gaussians(means, scales, quats, np.full(60, 3.0, f), sh)


def joined(*parts: Gaussians) -> Gaussians:
    names = ("means", "log_scales", "quats", "opacity_logits", "sh")
    return Gaussians(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


def scene_of(tmp_path, *models: SubmapModel) -> tuple[SceneModel, tuple[Submap, ...]]:
    submaps, folders = [], []
    for i, model in enumerate(models):
        positions = np.array([[4.0 * i + x, 0.0, 1.5] for x in (-1.0, 0.0, 1.0)])
        submaps.append(Submap(i, (3 * i, 3 * i + 1, 3 * i + 2), (3 * i, 3 * i + 1, 3 * i + 2), positions))
        folders.append(tmp_path / f"model{i}")
        save_model(model, folders[-1])
    return SceneModel(submaps, folders), tuple(submaps)


def drawn(scene: SceneModel, submaps: tuple[Submap, ...]) -> tuple[Frame, np.ndarray]:
    positions = np.concatenate([s.positions for s in submaps])
    owners = np.concatenate([np.full(len(s.positions), s.index) for s in submaps])
    frame = Frame.around(positions)
    return frame, draw_plan(scene, frame, positions, owners)


def color_at(frame: Frame, image: np.ndarray, x: float, y: float) -> np.ndarray:
    column, row = frame.pixel(x, y)
    return image[int(row), int(column)].astype(int)


def test_what_stands_is_drawn_at_its_place_and_what_hangs_is_not(tmp_path):
    red, blue = ball(-1.0, 2.0, 0.5, (1, 0, 0)), ball(1.5, -1.0, 1.7, (0, 0, 1))
    model = SubmapModel(joined(red, blue, ball(0.0, 1.0, 2.4, (0, 1, 0))), None, None, FloorSurface.flat(0.0))
    frame, image = drawn(*scene_of(tmp_path, model))
    np.testing.assert_allclose(color_at(frame, image, -1.0, 2.0), (255, 0, 0), atol=12)
    np.testing.assert_allclose(color_at(frame, image, 1.5, -1.0), (0, 0, 255), atol=12)
    assert (color_at(frame, image, 0.0, 1.0) == 245).all(), "what is higher than the cut is left out"
    reds = np.argwhere((image[..., 0] > 150) & (image[..., 1] < 100))
    column, row = frame.pixel(-1.0, 2.0)
    np.testing.assert_allclose(reds.mean(axis=0) + 0.5, (row, column), atol=1.5)


def test_the_floor_is_the_texture(tmp_path):
    level = np.zeros((2, 2, 3), np.float32)
    level[1, 1] = (0.2, 0.6, 0.4)  # the north-east quarter
    texture = FloorTexture((level,), (-4.0, -4.0), (4.0, 4.0))
    frame, image = drawn(*scene_of(tmp_path, SubmapModel(Gaussians.empty(), None, texture, FloorSurface.flat(0.0))))
    np.testing.assert_allclose(color_at(frame, image, 3.0, 3.0), (51, 153, 102), atol=2)


def test_each_place_is_of_the_submap_whose_camera_passed_nearest(tmp_path):
    west, east = (
        SubmapModel(joined(ball(0.0, 2.0, 0.5, c), ball(4.0, 2.0, 0.5, c)), None, None, FloorSurface.flat(0.0))
        for c in ((1, 0, 0), (0, 1, 0))
    )
    frame, image = drawn(*scene_of(tmp_path, west, east))
    np.testing.assert_allclose(color_at(frame, image, 0.0, 2.0), (255, 0, 0), atol=12)
    np.testing.assert_allclose(color_at(frame, image, 4.0, 2.0), (0, 255, 0), atol=12)


@pytest.mark.parametrize("place", [(-2.5, 3.25), (4.0, -1.0)])
def test_the_matrix_is_what_the_frame_does(place):
    frame = Frame.around(np.array([[-3.0, -2.0, 1.0], [5.0, 4.0, 1.0]]))
    np.testing.assert_allclose(np.array(frame.world_to_pixel) @ [*place, 1.0], frame.pixel(*place))
    column, row = frame.pixel(*place)
    np.testing.assert_allclose(frame.centers()[int(row), int(column)], place, atol=frame.meters)


def test_storeys_over_one_another_have_plans_of_their_own():
    row = np.column_stack([np.linspace(0, 8, 40), np.zeros(40)])
    floors = [np.column_stack([row, np.full(40, z)]) for z in (1.5, 4.5)]
    frames = [tuple(range(40 * i, 40 * i + 40)) for i in range(2)]
    submaps = tuple(Submap(i, frames[i], frames[i], floors[i]) for i in range(2))
    places = {"low": (1.0, 0.0, 1.5), "high": (1.0, 0.0, 4.5), "also low": (3.0, 0.0, 1.6)}
    graph = NavGraph("house", {id: Viewpoint(id, place) for id, place in places.items()}, {})
    found = list(storeys_with(graph, submaps))
    assert [(s.number, s.ids) for s in found] == [(1, ("low", "also low")), (2, ("high",))]
    assert [set(s.owners.tolist()) for s in found] == [{0}, {1}]
