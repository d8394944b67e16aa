"""Normals turned to the main directions of a building: of rooms that are at right angles, askew, round, and sloped."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.perception.main_directions import main_headings, straighten_normals


def noisy(normals: np.ndarray, degrees: float) -> np.ndarray:
    """(H, W, 3) float32 unit, each off by some degrees at random."""
    rng = np.random.Generator(np.random.PCG64(7))
    off = normals + np.tan(np.radians(degrees)) * rng.normal(size=normals.shape) / np.sqrt(2)
    return (off / np.linalg.norm(off, axis=-1, keepdims=True)).astype(np.float32)


def room(heading: float, off: float = 0.0) -> np.ndarray:
    """(80, 120, 3): ceiling above, floor below, three walls of a heading between."""
    found = np.zeros((80, 120, 3), np.float32)
    found[:20], found[60:] = (0, 0, -1), (0, 0, 1)
    for k, columns in enumerate((slice(0, 40), slice(40, 80), slice(80, 120))):
        angle = heading + off + k * np.pi / 2
        found[20:60, columns] = (np.cos(angle), np.sin(angle), 0)
    return found


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip((a * b).sum(-1), -1, 1))).mean())


def distance(a: float, b: float) -> float:
    return float(abs((a - b + np.pi / 4) % (np.pi / 2) - np.pi / 4))


@settings(max_examples=40, deadline=None)
@given(heading=st.floats(0, np.pi / 2), off=st.floats(-0.2, 0.2))
def test_a_capture_corrects_the_heading_of_an_image(heading: float, off: float) -> None:
    images = [noisy(room(heading), 4) for _ in range(5)]
    headings = main_headings(images)
    assert len(headings) == 1 and distance(headings[0], heading) < 0.02
    seen = noisy(room(heading, off), 4)
    found = straighten_normals(seen, headings)
    assert angle_between(found, room(heading)) < 1.5 < angle_between(seen, room(heading))
    assert np.allclose(straighten_normals(found, headings), found, atol=1e-6)
    assert np.allclose(np.linalg.norm(found, axis=-1), 1, atol=1e-3)


def test_two_wings_have_two_headings_and_each_image_is_of_one() -> None:
    wings = [noisy(room(h), 5) for h in (0.1, 0.1, 0.1, 0.8, 0.8)]
    headings = main_headings(wings)
    assert len(headings) == 2 and distance(headings[0], 0.1) < 0.02 and distance(headings[1], 0.8) < 0.02
    for heading in (0.1, 0.8):
        assert angle_between(straighten_normals(noisy(room(heading), 5), headings), room(heading)) < 1.0


def test_a_room_askew_keeps_its_walls() -> None:
    headings = main_headings([room(0.1)] * 9)
    seen = noisy(room(0.6), 2)
    found = straighten_normals(seen, headings)
    assert np.array_equal(found[20:60], seen[20:60])
    assert np.array_equal(found[62:, :, 2], np.ones((18, 120), np.float32))  # floor is floor there too


def test_round_walls_stay_and_ramps_too() -> None:
    angles = np.linspace(0, 2 * np.pi, 120)
    tower = room(0.0)
    tower[20:60] = np.stack([np.cos(angles), np.sin(angles), 0 * angles], -1)
    assert main_headings([tower] * 4) == ()
    assert np.array_equal(straighten_normals(tower, ()), tower)
    slope = np.radians(25)
    tower[60:] = (0, np.sin(slope), np.cos(slope))
    assert np.array_equal(straighten_normals(tower, (0.0,))[60:], tower[60:])


@pytest.mark.parametrize("images", [[], [np.zeros((80, 120, 3), np.float32)], [room(0.3)[:20]]])
def test_without_walls_there_is_no_heading(images: list[np.ndarray]) -> None:
    assert main_headings(images) == ()


def test_what_is_unknown_stays_so() -> None:
    seen = room(0.3)
    seen[:, :7] = 0
    assert not straighten_normals(seen, main_headings([seen]))[:, :7].any()
