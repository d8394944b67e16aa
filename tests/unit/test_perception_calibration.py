"""The calibration of a floor network in the box room of `test_perception_geometric`, and masks that it leaves open."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from nvsim.perception.fused import (
    CalibratedFloor,
    FusedFloor,
    View,
    _Certain,
    _with_colors,
    calibrate,
    fitting_temperature,
    log_odds,
)
from nvsim.perception.geometric import GeometricFloor
from tests.benchmarks.floor_fusion import Reliability
from tests.unit.test_perception_geometric import EYES, FLAT, camera, scan, truth

VIEWS = [View(camera(k), lambda k=k: truth(camera(k))[1], lambda: None, None) for k in range(len(EYES))]


class Network:
    """A SemanticFloor that gives the true floor the probability `right`, and is wrong in a share of its squares."""

    def __init__(self, right: float, wrong: float = 0.0) -> None:
        self._right, self._wrong = right, wrong

    def floor_probability(self, image, view):
        floor = truth(view)[0]
        rows, columns = np.indices(floor.shape) // 16
        swapped = np.random.default_rng(3).random((floor.shape[0] // 16 + 1, floor.shape[1] // 16 + 1)) < self._wrong
        return np.where(floor ^ swapped[rows, columns], self._right, 1 - self._right).astype(np.float32)


def geometry(share: float = 1.0) -> GeometricFloor:
    cloud = scan()
    kept = np.random.default_rng(5).random(len(cloud.points)) < share
    provider = GeometricFloor(type(cloud)(cloud.points[kept]), FLAT)
    provider.learn([view.camera for view in VIEWS], lambda k: VIEWS[k].image())
    return provider


@pytest.mark.parametrize("true", [0.5, 1.0, 3.0])
def test_the_temperature_that_made_the_labels_is_found(true: float) -> None:
    rng = np.random.default_rng(0)
    odds = rng.normal(0, 4, 100_000).astype(np.float32)
    is_floor = rng.random(len(odds)) < 1 / (1 + np.exp(-odds / true))
    assert fitting_temperature(odds, is_floor) == pytest.approx(true, rel=0.03)


def test_a_network_that_is_too_certain_is_corrected_by_the_capture_itself() -> None:
    floor = geometry()
    sharp = Network(0.999, wrong=0.15)
    calibrated = calibrate(sharp, floor, VIEWS, threads=2)
    # With probabilities p and 1 - p alone, the best p is the share of right pixels.
    assert 1 / (1 + np.exp(-np.log(999) / calibrated.temperature)) == pytest.approx(0.85, abs=0.06)
    before, after = Reliability(), Reliability()
    for view in VIEWS:
        known = truth(view.camera)[0]
        before.add(sharp.floor_probability(view.image(), view.camera).ravel(), known.ravel())
        after.add(calibrated.floor_probability(view.image(), view.camera).ravel(), known.ravel())
    assert before.error > 0.1 and after.error < 0.5 * before.error
    assert calibrate(sharp, floor, VIEWS).temperature == calibrated.temperature, "threads do not matter"


def test_a_network_that_is_right_keeps_its_certainty_and_few_pixels_change_nothing() -> None:
    assert calibrate(Network(0.95), geometry(), VIEWS).temperature < 1
    assert calibrate(Network(0.95, wrong=0.3), GeometricFloor(None, FLAT), VIEWS).temperature == 1


def test_ignored_pixels_do_not_count() -> None:
    def left(view: View) -> np.ndarray:
        return np.arange(view.camera.intrinsics.width)[None] < 120

    class Wrong(Network):
        """Wrong on the left."""

        def floor_probability(self, image, view):
            right = super().floor_probability(image, view)
            return np.where(np.arange(right.shape[1])[None] < 120, 1 - right, right)

    floor, wrong = geometry(), Wrong(0.95)
    seen = [v._replace(usable=lambda v=v: ~np.broadcast_to(left(v), v.image().shape[:2])) for v in VIEWS]
    assert calibrate(wrong, floor, VIEWS).temperature > 2 and calibrate(wrong, floor, seen).temperature < 1


def test_probabilities_keep_their_order_and_one_half_stays() -> None:
    class Fixed:
        def floor_probability(self, image, view):
            return np.array([[0, 1e-6, 0.2, 0.5, 0.9, 1]], np.float32)

    found = CalibratedFloor(Fixed(), 2.0).floor_probability(VIEWS[0].image(), VIEWS[0].camera)[0]
    assert (np.diff(found) > 0).all() and found[3] == 0.5
    assert log_odds(found)[[2, 4]] == pytest.approx(np.log([0.25, 9]) / 2, abs=1e-3)


def test_a_mask_that_geometry_leaves_open_and_the_network_too_is_called_unsure() -> None:
    cloud = scan()
    high = cloud.points[cloud.points[:, 2] > 0.3]
    open_floor = np.concatenate([high, cloud.points[(cloud.points[:, 2] < 0.05) & (cloud.points[:, 0] < 0.5)]])
    provider = GeometricFloor(type(cloud)(open_floor), FLAT)
    provider.learn([view.camera for view in VIEWS], lambda k: VIEWS[k].image())
    view = VIEWS[1]
    assert FusedFloor(provider, Network(0.55)).segment(view.camera, view.image()).failure == "unsure"
    assert FusedFloor(provider, Network(0.999)).segment(view.camera, view.image()).failure == ""
    assert FusedFloor(geometry(), Network(0.55)).segment(view.camera, view.image()).failure == "", "geometry knows it"


def colored_parts(views: int = 6, pixels: int = 2000) -> list[_Certain]:
    """Pixels of blue floor and red objects, with a little noise, and a network that is wrong about half of both."""
    rng = np.random.default_rng(0)
    parts = []
    for _ in range(views):
        is_floor = rng.random(pixels) < 0.3
        colors = np.where(is_floor[:, None], (40, 60, 160), (160, 60, 40)) + rng.normal(0, 8, (pixels, 3))
        odds = np.where(rng.random(pixels) < 0.5, 3.0, -3.0).astype(np.float32)
        parts.append(_Certain(odds, is_floor, np.clip(colors, 0, 255).astype(np.uint8)))
    return parts


def test_colors_decide_if_the_network_is_often_wrong() -> None:
    found = _with_colors(Network(0.95), 5.0, colored_parts())
    assert found.colors is not None and found.weight > 0.5 and found.temperature > 5
    assert found.colors.log_odds(np.array([40, 60, 160])) > 3 and found.colors.log_odds(np.array([160, 60, 40])) < -3
    assert abs(found.colors.log_odds(np.array([60, 200, 60]))) < 0.5, "colors that no view shows decide nothing"

    class Half:
        def floor_probability(self, image, view):
            return np.full(image.shape[:2], 0.5, np.float32)

    image = np.zeros((40, 60, 3), np.uint8)
    image[:, :30], image[:, 30:] = (40, 60, 160), (160, 60, 40)
    said = CalibratedFloor(Half(), 1.0, found.colors, found.weight).floor_probability(image, camera(0))
    assert (said[:, :28] > 0.9).all() and (said[:, 32:] < 0.1).all()


def test_colors_that_tell_nothing_have_no_weight() -> None:
    rng = np.random.default_rng(1)
    parts = [
        _Certain(part.odds, part.is_floor, rng.integers(60, 200, part.colors.shape).astype(np.uint8))
        for part in colored_parts()
    ]
    assert _with_colors(Network(0.95), 5.0, parts).weight < 0.1


def test_colors_count_only_beside_depth_from_images_and_an_unsure_network() -> None:
    floor = geometry()

    def depth(view: View) -> np.ndarray:
        """Depth of the floor, and half of it on everything before the floor."""
        small = floor._working_camera(view.camera)
        ground = floor.project(view.camera).distance * (small.rays() @ small.rotation[:, 2])
        shown = cv2.resize(truth(view.camera)[0].astype(np.uint8), ground.shape[::-1], interpolation=cv2.INTER_NEAREST)
        return np.where(shown > 0, ground, 0.5 * ground).astype(np.float32)

    assert calibrate(Network(0.999, wrong=0.4), floor, VIEWS).colors is None
    with_depth = [v._replace(depth=lambda v=v: depth(v)) for v in VIEWS]
    assert calibrate(Network(0.999, wrong=0.4), floor, with_depth).colors is not None
    assert calibrate(Network(0.95), floor, with_depth).colors is None
