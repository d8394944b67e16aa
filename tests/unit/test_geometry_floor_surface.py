"""Heights of a floor surface against scipy's interpolation."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
from scipy.ndimage import map_coordinates

from nvsim.geometry.floor_surface import FloorSurface

HEIGHTS = np.random.default_rng(0).normal(size=(7, 11)).astype(np.float32)
SURFACE = FloorSurface(HEIGHTS, (-2.0, 3.0), 0.5)


def test_heights_are_bilinear_inside_and_those_of_the_border_outside() -> None:
    xy = np.random.default_rng(1).uniform((-4, 1), (6, 9), (40, 50, 2))
    at = [(xy[..., 1] - 3.0) / 0.5, (xy[..., 0] + 2.0) / 0.5]
    expected = map_coordinates(HEIGHTS.astype(np.float64), at, order=1, mode="nearest")
    found = SURFACE.height_at(xy)
    assert found.shape == (40, 50) and found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_any_array_of_places_will_do() -> None:
    xy = np.random.default_rng(2).uniform(-1, 2, (6, 3))
    found = SURFACE.height_at(xy)
    np.testing.assert_allclose(SURFACE.height_at(xy.astype(np.float32)), found, atol=1e-5)
    np.testing.assert_array_equal(SURFACE.height_at(xy[::-1])[::-1], found)
    np.testing.assert_array_equal(SURFACE.height_at(np.asfortranarray(xy)), found)
    assert SURFACE.height_at(xy[0]).shape == () and float(SURFACE.height_at(xy[0])) == found[0]
    assert SURFACE.height_at(np.zeros((0, 2))).shape == (0,)
    assert np.isnan(SURFACE.height_at(np.array([np.nan, 0.0]))) and np.isfinite(SURFACE.height_at(np.array([9e99, 0])))


def test_one_place_after_the_other_gives_what_many_give_to_the_last_bit() -> None:
    xy = np.random.default_rng(3).uniform((-4, 1), (6, 9), (300, 2))
    xy[::50] = np.nan
    np.testing.assert_array_equal([float(SURFACE.height_at(place)) for place in xy], SURFACE.height_at(xy))


def test_what_a_window_asks_of_a_graph_compiles_nothing() -> None:
    """Importing numba takes a second, for which the window would stand still."""
    program = (
        "import sys, numpy as np\n"
        "from nvsim.geometry.floor_surface import FloorSurface\n"
        "from nvsim.mapping.corridor import Corridor\n"
        "from nvsim.mapping.explanation.explain import closed_path_test\n"
        "floor = FloorSurface(np.ones((3, 3), np.float32), (0.0, 0.0), 1.0)\n"
        "print(float(floor.height_at(np.zeros(2))), Corridor((0.0, 0.0), (1.0, 2.0)).cells().shape[1])\n"
        "print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1.0", "18", "False"]
