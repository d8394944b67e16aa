"""Thin bars over patterned floors, drawn by projection: raised bars are found in place, and marks on the floor are
not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.perception.line_kernels import is_shown
from nvsim.perception.raised_lines import LineConfig, RaisedLines, raised_lines, thin_object_places
from nvsim.perception.support import observe

LENS = Intrinsics.from_fov(480, 360, np.radians(80))
FLOOR = 0.3  # meters, world
_FINER = 4  # samples of a pixel along each side


def cameras() -> list[Camera]:
    """On two sides of the middle of a room, looking there and down."""
    found = []
    for y, heading in ((-1.3, 0.0), (1.3, np.pi)):
        for x in np.linspace(-1.2, 1.2, 7):
            found.append(Camera(LENS, camera_pose(np.array([x, y, FLOOR + 1.3]), heading + 0.1 * x, np.radians(-30))))
    return found


def drawn(camera: Camera, bar: float | None, planks: float | None) -> NDArray[np.uint8]:
    """A gray floor with planks along x so many meters wide, and a dark bar along x over y = 0 at a height in meters."""
    lens = LENS.scaled(LENS.width * _FINER, LENS.height * _FINER)
    right = ((np.arange(lens.width) + 0.5 - lens.cx) / lens.fx).astype(np.float32)
    down = ((np.arange(lens.height) + 0.5 - lens.cy) / lens.fy).astype(np.float32)[:, None]
    # Rays with a depth of 1, one component after the other: arrays of all three take most of the time of the test.
    ahead, aside, up = (a * right + b * down + c for a, b, c in camera.rotation.astype(np.float32))
    falling = np.minimum(up, -1e-3)

    def at(height: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """x and y at which the rays reach a height above the floor."""
        reach = np.float32(FLOOR + height - camera.position[2]) / falling
        x, y = camera.position[:2].astype(np.float32)
        return x + reach * ahead, y + reach * aside

    image = np.full(up.shape, 150.0, np.float32)
    if planks is not None:
        image[(np.floor(at(0.0)[1] / planks) % 2).astype(bool)] += 25
    if bar is not None:
        x, y = at(bar)
        image[(np.abs(y) < 0.025) & (np.abs(x) < 0.7)] = 40
    image[up > -0.05] = 200
    small = cv2.resize(image, (LENS.width, LENS.height), interpolation=cv2.INTER_AREA)
    return np.repeat(small[..., None], 3, axis=2).round().astype(np.uint8)


def found(bar: float | None, planks: float | None) -> tuple[RaisedLines, NDArray[np.float64]]:
    views = cameras()
    images = [drawn(view, bar, planks) for view in views]
    lines = raised_lines(views, images.__getitem__, np.full(len(views), FLOOR))
    return lines, thin_object_places(lines, np.array([v.position for v in views]))


@pytest.mark.parametrize("height", [0.15, 0.25])
def test_a_bar_above_the_floor_is_found_where_it_is(height: float) -> None:
    lines, places = found(height, None)
    assert np.abs(lines.height - height).max() < 0.05
    assert np.abs(places[:, 1]).max() < 0.1 and np.abs(places[:, 0]).max() < 0.8
    assert len(np.unique(places[np.abs(places[:, 0]) < 0.6, 0])) > 15, "most of its length"


def test_a_bar_stands_out_of_a_floor_of_planks() -> None:
    _, places = found(0.2, 0.14)
    assert len(places) > 5
    assert np.abs(places[:, 1]).max() < 0.15


@pytest.mark.parametrize(("bar", "planks"), [(0.0, None), (None, 0.14), (0.0, 0.2), (0.05, None), (None, None)])
def test_what_lies_on_the_floor_or_is_stepped_over_does_not_stand(bar: float | None, planks: float | None) -> None:
    assert len(found(bar, planks)[1]) == 0


def test_cameras_of_which_the_floor_is_unknown_are_left_out() -> None:
    views = cameras()
    images = [drawn(view, 0.2, None) for view in views]
    assert len(raised_lines(views, images.__getitem__, np.full(len(views), np.nan))) == 0
    assert len(raised_lines([], images.__getitem__, np.zeros(0))) == 0


def test_a_line_is_shown_by_segments_that_cover_half_of_it() -> None:
    def shown(*segments: tuple[float, float, float, float]) -> bool:
        return bool(is_shown(10.0, 10.0, 60.0, 10.0, np.array(segments, np.float64).reshape(-1, 4), 1.5))

    assert shown((10, 10.5, 60, 10.5)) and shown((60, 9.5, 10, 9.5)), "either way round"
    assert shown((12, 10, 25, 10), (40, 10, 55, 10)) and not shown((12, 10, 25, 10))
    assert not shown((10, 12, 60, 12)), "beside it"
    assert not shown((10, 8, 60, 12.5)), "slanted"
    assert not shown(), "no segment at all"


def test_one_camera_alone_is_not_believed() -> None:
    line = np.array([[0.0, 0.0]]), np.array([[1.0, 0.0]]), np.array([0.2])
    several = RaisedLines(*(np.repeat(part, 6, axis=0) for part in line), camera=np.arange(6))
    apart = np.column_stack([np.arange(6), np.full(6, 2.0), np.full(6, 1.3)])
    assert len(thin_object_places(several, apart)) == 21, "every 5 cm of it"
    assert len(thin_object_places(several, apart * [0.01, 1, 1])) == 0, "seen from one place only"
    high = RaisedLines(several.start, several.end, np.arange(6) * 0.06, several.camera)
    assert len(thin_object_places(high, apart)) == 0, "each says another height"


def test_nothing_leads_over_what_stands() -> None:
    view = Camera(LENS, camera_pose(np.array([0.0, -1.5, 1.5]), 0.0, np.radians(-45)))
    masks = [np.ones((LENS.height, LENS.width), bool)] * 2
    bar = np.column_stack([np.arange(-0.5, 0.5, 0.05), np.zeros(20)])
    known = observe([view, view], masks, FloorSurface.flat(0.0), None, raised=bar)
    assert not known.is_supported(bar).any() and not known.is_supported(bar + [0.0, 0.04]).any()
    assert known.is_supported(bar + [0.0, 0.2]).all() and known.is_supported(bar - [0.0, 0.2]).all()
    under_the_walk = known.with_trajectory_floor(np.column_stack([bar, np.full(20, 1.5)]))
    assert not under_the_walk.is_supported(bar).any(), "a hand reaches over it"
    rows = np.arange(0.0, 0.1, 0.01)
    for start in rows:  # the rows of a corridor lie 0.1 m apart
        steps = np.column_stack([np.zeros(8), -0.4 + start + 0.1 * np.arange(8)])
        assert not known.is_supported(steps).all(), "no row of cells steps over it"
    assert LineConfig().lowest == 0.1
