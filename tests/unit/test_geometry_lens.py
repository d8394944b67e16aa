"""Lenses, against OpenCV's own distortion models."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from nvsim.geometry.camera import Intrinsics
from nvsim.geometry.lens import Lens

MATRIX = np.array([[410.0, 0, 318.5], [0, 405.0, 242.25], [0, 0, 1]])
PIXEL = (410.0, 405.0, 318.5, 242.25)


def points() -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.7, 0.7, (500, 2))


def opencv(normalized: np.ndarray, coefficients: list[float], fisheye: bool, matrix: np.ndarray = MATRIX) -> np.ndarray:
    if fisheye:
        return cv2.fisheye.distortPoints(normalized[:, None], matrix, np.array(coefficients))[:, 0]
    local = np.concatenate([normalized, np.ones((len(normalized), 1))], axis=1)
    return cv2.projectPoints(local, np.zeros(3), np.zeros(3), matrix, np.array(coefficients))[0][:, 0]


@pytest.mark.parametrize(
    ("model", "params", "coefficients", "fisheye"),
    [
        ("PINHOLE", PIXEL, [0, 0, 0, 0], False),
        ("OPENCV", (*PIXEL, -0.12, 0.03, 0.002, -0.001), [-0.12, 0.03, 0.002, -0.001], False),
        (
            "FULL_OPENCV",
            (*PIXEL, -0.1, 0.03, 0.002, -0.001, 0.01, 0.02, -0.01, 0.003),
            [-0.1, 0.03, 0.002, -0.001, 0.01, 0.02, -0.01, 0.003],
            False,
        ),
        ("OPENCV_FISHEYE", (*PIXEL, 0.02, -0.01, 0.003, -0.001), [0.02, -0.01, 0.003, -0.001], True),
    ],
)
def test_distortion_is_opencvs(model: str, params: tuple, coefficients: list, fisheye: bool) -> None:
    lens = Lens(model, 640, 480, params)
    np.testing.assert_allclose(lens.distort(points()), opencv(points(), coefficients, fisheye), atol=1e-9)


@pytest.mark.parametrize(
    ("model", "extra", "coefficients", "fisheye"),
    [
        ("SIMPLE_PINHOLE", (), [0, 0, 0, 0], False),
        ("SIMPLE_RADIAL", (-0.1,), [-0.1, 0, 0, 0], False),
        ("RADIAL", (-0.1, 0.04), [-0.1, 0.04, 0, 0], False),
        ("SIMPLE_RADIAL_FISHEYE", (0.05,), [0.05, 0, 0, 0], True),
        ("RADIAL_FISHEYE", (0.05, -0.02), [0.05, -0.02, 0, 0], True),
    ],
)
def test_models_with_one_focal_length_are_opencvs_too(
    model: str, extra: tuple, coefficients: list, fisheye: bool
) -> None:
    lens = Lens(model, 640, 480, (400.0, 318.5, 242.25, *extra))
    matrix = np.array([[400.0, 0, 318.5], [0, 400.0, 242.25], [0, 0, 1]])
    np.testing.assert_allclose(lens.distort(points()), opencv(points(), coefficients, fisheye, matrix), atol=1e-9)


def test_the_undistort_map_is_opencvs_half_a_pixel_apart() -> None:
    coefficients = np.array([-0.12, 0.03, 0.002, -0.001])
    lens = Lens("OPENCV", 640, 480, (*PIXEL, *coefficients))
    target = Intrinsics(320, 240, 210.0, 205.0, 161.0, 118.0)
    # OpenCV puts the first pixel's center at 0, the lens at 0.5.
    shifted, new = MATRIX.copy(), np.array([[210.0, 0, 160.5], [0, 205.0, 117.5], [0, 0, 1]])
    shifted[:2, 2] -= 0.5
    expected = np.stack(cv2.initUndistortRectifyMap(shifted, coefficients, None, new, (320, 240), cv2.CV_32FC1), -1)
    np.testing.assert_allclose(lens.undistort_map(target), expected, atol=2e-3)


@pytest.mark.parametrize("k1", [-0.2, 0.15])
def test_the_pinhole_of_a_distorted_lens_sees_no_pixel_outside_the_image(k1: float) -> None:
    lens = Lens("OPENCV", 640, 480, (400.0, 400.0, 320.0, 240.0, k1, 0.0, 0.0, 0.0))
    samples = lens.undistort_map(lens.pinhole) + 0.5
    assert samples.min() > -0.6 and samples[..., 0].max() < 640.6 and samples[..., 1].max() < 480.6
    assert (lens.pinhole.fx == 400.0) == (k1 < 0), "a barrel image needs no longer focal length"
    if k1 > 0:  # and it is the least factor: some border sample lies on the border
        assert min(samples[..., 0].min(), 640 - samples[..., 0].max(), samples[..., 1].min()) < 1.0


def test_a_polynomial_that_turns_back_does_not_mirror_the_image() -> None:
    phone = (219.3, 219.3, 108.0, 144.0, 0.3095, -1.685, 0.0005, 0.0003, 2.777, 0, 0, 0)
    lens = Lens("FULL_OPENCV", 216, 288, phone)
    samples = lens.undistort_map(lens.pinhole)
    assert (np.diff(samples[:, :, 0], axis=1) > 0).all() and (np.diff(samples[:, :, 1], axis=0) > 0).all()


def test_an_undistorted_pinhole_is_exactly_itself() -> None:
    assert Lens("PINHOLE", 640, 480, PIXEL).pinhole == Intrinsics(640, 480, *PIXEL)


@pytest.mark.parametrize(
    ("model", "size", "params"),
    [
        ("FOV", (640, 480), PIXEL),
        ("PINHOLE", (640, 480), PIXEL[:3]),
        ("PINHOLE", (0, 480), PIXEL),
        ("PINHOLE", (640, 480), (float("nan"), *PIXEL[1:])),
        ("PINHOLE", (640, 480), (-1.0, *PIXEL[1:])),
    ],
)
def test_a_lens_that_cannot_be_is_refused(model: str, size: tuple, params: tuple) -> None:
    with pytest.raises(ValueError):
        Lens(model, *size, params)
