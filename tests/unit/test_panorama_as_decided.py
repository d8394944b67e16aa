"""The alpha that the inspector lays over a panorama is the one that the map builder decides by."""

from __future__ import annotations

import numpy as np

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.panorama import render_equirectangular
from nvsim.splats.types import Gaussians, SubmapModel
from nvsim_app.drawing.painter import Models, Painter
from nvsim_app.drawing.panorama_child import PanoramaDrawing, PanoramaRequest

WIDTH = 256


def beside_a_wall() -> SubmapModel:
    """A wall 0.6 m to the east of the origin, of flat Gaussians that are wide for so near an eye."""
    y, z = np.meshgrid(np.arange(-2, 3, 0.2), np.arange(-1.4, 1, 0.2))
    means = np.stack([np.full(y.size, 0.6), y.ravel(), z.ravel()], axis=1)
    scales, quats = np.log([[0.01, 0.2, 0.2]]).repeat(len(means), 0), np.array([[1, 0, 0, 0]]).repeat(len(means), 0)
    arrays = means, scales, quats, np.full(len(means), 2.0), np.zeros((len(means), 1, 3))
    return SubmapModel(Gaussians(*(np.ascontiguousarray(a, np.float32) for a in arrays)), None, None, FLOOR)


FLOOR = FloorSurface.flat(-1.5)


def test_a_wall_beside_the_eye_is_not_drawn_over_the_floor_at_its_feet() -> None:
    model = beside_a_wall()
    drawing = PanoramaDrawing(Painter(Models(lambda camera: (0, model))).look_around)
    drawing.begin(PanoramaRequest("here", (0.0, 0.0, 0.0), (WIDTH,)))
    (made,) = [panorama for panorama in (drawing.step() for _ in range(40)) if panorama is not None]
    shown = made.pixels["alpha"][..., 0] / 255.0
    decided = render_equirectangular(model, np.zeros(3), WIDTH, WIDTH // 2, frozenset({"alpha"}), backend="numba").alpha
    assert decided is not None
    np.testing.assert_allclose(shown, decided, atol=0.01)
    feet = shown[WIDTH // 2 * 7 // 9 : WIDTH // 2 * 8 // 9, : WIDTH // 2]  # 50 to 70 degrees down, to the west
    assert feet.max() < 0.01 and shown[WIDTH // 4, WIDTH * 3 // 4] > 0.9
