"""The criterion of rendered depth, on views whose depth is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from columns import flat_floor
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import Corridor
from nvsim.mapping.criteria import corridor_of, decide
from nvsim.mapping.views.floor_view import FloorView, measure
from nvsim.mapping.views.view_sources import camera_towards

CONFIG = MappingConfig(criteria=("depth",), lattice_offset=0.0)
HEIGHT = 1.5
CORRIDOR = Corridor((0.0, 0.0), (0.0, 2.5))


def plane(camera: Camera, z: float) -> NDArray[np.float64]:
    """(H, W) depth along the optical axis of a horizontal plane; 0 where a ray does not meet it."""
    rays = camera.rays().astype(np.float64)
    along = np.where(rays[..., 2] < -1e-6, (z - camera.position[2]) / np.minimum(rays[..., 2], -1e-6), 0.0)
    return along * (rays @ camera.rotation[:, 2])


def reach_of(alpha: float, z: float, config: MappingConfig = CONFIG) -> tuple[NDArray[np.float64], str]:
    """What is measured through a sheet of one alpha at height z: of the cells that the robot needs, and decided."""
    camera = camera_towards(np.array([0.0, 0.0, HEIGHT]), 0.0, config)
    shape = (config.view_size, config.view_size)
    depth = plane(camera, z) if alpha else np.zeros(shape)
    filled = np.full(shape, alpha, np.float32)
    view = FloorView(0, camera, filled, filled * 0, np.ones(shape, bool), (alpha * depth).astype(np.float32))
    found = measure(view, "v", 0, CORRIDOR, flat_floor, lambda xy: np.ones(xy.shape[:-1], bool))
    assert found.reach is not None
    return found.reach[corridor_of(found, config)] / 255, decide(found, config)


@pytest.mark.parametrize(("alpha", "z"), [(1.0, 0.75), (1.0, 0.3), (0.4, 0.75), (1.0, 0.0), (0.2, 1.2)])
def test_the_reach_falls_by_the_height_of_what_hides_the_floor(alpha: float, z: float) -> None:
    # Along a ray the way left to the floor is as long, of the whole, as its height is of the camera's.
    found, _ = reach_of(alpha, z)
    assert found == pytest.approx(np.full(found.shape, 1 - alpha * z / HEIGHT), abs=0.01)


@pytest.mark.parametrize(
    ("alpha", "z", "decision"),
    [(0.0, 0.0, "open"), (1.0, 0.0, "open"), (1.0, 0.05, "open"), (1.0, 0.4, "depth"), (0.05, 0.75, "open")],
    ids=["nothing", "Gaussians on the floor", "a rug", "a stool", "haze"],
)
def test_floor_is_reached_whether_gaussians_or_the_background_show_it(alpha: float, z: float, decision: str) -> None:
    assert reach_of(alpha, z)[1] == decision


def test_what_lies_outside_the_view_is_not_reached() -> None:
    camera = camera_towards(np.array([0.0, 0.0, HEIGHT]), np.pi, CONFIG)
    empty = np.zeros((CONFIG.view_size, CONFIG.view_size), np.float32)
    view = FloorView(0, camera, empty, empty, empty == 0, empty)
    found = measure(view, "v", 0, CORRIDOR, flat_floor, lambda xy: np.ones(xy.shape[:-1], bool))
    assert found.reach is not None and found.reach[-1].max() == 0 and decide(found, CONFIG) == "depth"
