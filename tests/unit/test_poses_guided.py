"""Photographs are matched again along the epipolar lines of their poses."""

from __future__ import annotations

import numpy as np
import pycolmap
import pytest

from nvsim.poses.features import Features, match_descriptors
from nvsim.poses.match_database import Keypoints
from nvsim.poses.predicted_pairs import guided_pairs

WIDTH, HEIGHT, FOCAL, POINTS = 640, 480, 500.0, 400


def _unit(values: np.ndarray) -> np.ndarray:
    return np.asarray(values / np.linalg.norm(values, axis=-1, keepdims=True), np.float32)


def test_vectors_in_parts_match_like_all_at_once() -> None:
    rng = np.random.default_rng(3)
    one = _unit(rng.random((700, 128)))
    other = _unit(one[rng.permutation(700)[:610]] + rng.normal(0, 0.03, (610, 128)))
    likeness = one @ other.T
    first = np.sort(likeness, axis=1)[:, ::-1]
    best, back = likeness.argmax(axis=1), likeness.argmax(axis=0)
    clear = (back[best] == np.arange(700)) & (1 - first[:, 0] < 0.64 * (1 - first[:, 1]))
    expected = np.stack([np.flatnonzero(clear), best[clear]], axis=1)
    assert 300 < len(expected) < 700
    np.testing.assert_array_equal(match_descriptors(one, other, 0.8), expected)


def test_only_allowed_vectors_match() -> None:
    one = _unit(np.eye(4, 128))
    allowed = np.array([[False, True, False, False]] + [[True] * 4] * 3)
    found = match_descriptors(one, one, 0.99, lambda rows: allowed[rows])
    assert [0, 0] not in found.tolist() and [1, 1] in found.tolist()


@pytest.fixture(scope="module")
def scene() -> tuple[pycolmap.Reconstruction, list[Keypoints], np.ndarray]:
    """Two cameras that see the same points. Every descriptor occurs four times, so that no match is clear in the whole
    image."""
    rng = np.random.default_rng(0)
    points = rng.uniform((-1.2, -0.9, 2.5), (1.2, 0.9, 4.5), (POINTS, 3))
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        camera_id=1, model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, params=[FOCAL, WIDTH / 2, HEIGHT / 2, 0.0]
    )
    model.add_camera_with_trivial_rig(camera)
    descriptors = rng.integers(0, 255, (POINTS // 4, 128)).repeat(4, axis=0)
    keypoints, order = [], rng.permutation(POINTS)
    for number, x in enumerate((0.0, 0.6), 1):
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([-x, 0.0, 0.0]))
        seen = points + pose.translation
        places = FOCAL * seen[:, :2] / seen[:, 2:] + (WIDTH / 2, HEIGHT / 2)
        rows = np.arange(POINTS) if number == 1 else order
        noise = rng.integers(-2, 3, (POINTS, 128))
        own = Features(places[rows], np.clip(descriptors[rows] + noise, 0, 255).astype(np.uint8))
        keypoints.append(Keypoints(own, np.zeros(0, np.int64), np.zeros((0, 2))))
        image = pycolmap.Image(name=f"{number}.jpg", camera_id=1, image_id=number, keypoints=places[rows])
        model.add_image_with_trivial_frame(image, pose)
    for k in range(POINTS):
        track = pycolmap.Track()
        track.add_element(1, k)
        track.add_element(2, int(np.flatnonzero(order == k)[0]))
        model.add_point3D(points[k], track, np.zeros(3, np.uint8))
    return model, keypoints, order


def test_repeated_features_match_along_epipolar_lines(
    scene: tuple[pycolmap.Reconstruction, list[Keypoints], np.ndarray],
) -> None:
    model, keypoints, order = scene
    before = keypoints[0].matches(keypoints[1], False)
    assert len(before) < 0.2 * POINTS
    views = guided_pairs(model, keypoints, {})[0, 1]
    right = order[views.matches[:, 1]] == views.matches[:, 0]
    assert len(views.matches) > 0.5 * POINTS
    assert right.mean() > 0.97


def test_pairs_that_matched_better_before_stay(
    scene: tuple[pycolmap.Reconstruction, list[Keypoints], np.ndarray],
) -> None:
    model, keypoints, _ = scene
    found = guided_pairs(model, keypoints, {})
    assert guided_pairs(model, keypoints, found) == {}
