"""Blurred frames that only connect others are removed from a reconstruction."""

from __future__ import annotations

import numpy as np
import pytest
from known_reconstruction import center_of, facing, places_in, pose, reconstruction

from nvsim.poses.pieces import names_in, without_bridges


def _walk(degrees: float) -> object:
    """Twelve images of a camera that rotates by `degrees` from one to the next, among points all around."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-4, 4, (3000, 3)) + [0, 0, 1]
    at = {}
    for k, angle in enumerate(np.radians(degrees * np.arange(12))):
        ahead = np.array([np.cos(angle), np.sin(angle), 0])
        at[k + 1] = pose(facing(ahead), np.array([0.05 * k, 0, 1]))
    places, shown = {}, {}
    for number, one in at.items():
        pixels, seen = places_in(one, points)
        shown[number], places[number] = np.flatnonzero(seen), pixels[seen]
    return reconstruction(at, points, shown, places)


@pytest.mark.parametrize(
    ("degrees", "blurred", "removed"),
    [
        (2.0, [4, 5, 9], [4, 5, 9]),
        (2.0, [1, 12], []),  # at an end, no sharp image follows
        (2.0, [3, 4, 5, 6], [3, 4, 5]),  # five frames from one sharp image to the next, so that one of them stays
        (10.0, [4], [4]),
        (10.0, [4, 5], [4]),  # 30 degrees from the sharp image before to the one after
        (30.0, [4, 5], []),  # no two images have enough in common
    ],
)
def test_blurred_images_between_sharp_ones_are_removed(degrees: float, blurred: list[int], removed: list[int]) -> None:
    model = _walk(degrees)
    before = {n: center_of(model.images[n].cam_from_world()) for n in model.reg_image_ids()}
    assert without_bridges(model, {f"{n:06d}.jpg" for n in blurred}) == tuple(f"{n:06d}.jpg" for n in removed)
    assert names_in(model) == tuple(f"{n:06d}.jpg" for n in range(1, 13) if n not in removed)
    for n in model.reg_image_ids():
        np.testing.assert_array_equal(center_of(model.images[n].cam_from_world()), before[n])
    for point in model.points3D.values():
        assert all(element.image_id not in removed for element in point.track.elements)
