"""Rotations, against scipy and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nvsim.geometry.rotation import is_rigid, matrix_from_quaternion, smallest_rotation


def test_quaternions_become_scipys_matrices() -> None:
    rotations = Rotation.random(50, random_state=0)
    quaternions = np.roll(rotations.as_quat(), 1, axis=1) * np.linspace(0.5, 3, 50)[:, None]
    np.testing.assert_allclose(matrix_from_quaternion(quaternions), rotations.as_matrix(), atol=1e-12)


def test_the_smallest_rotation_turns_by_the_angle_between_and_no_more() -> None:
    rng = np.random.default_rng(1)
    for a, b in rng.normal(size=(50, 2, 3)):
        turn = smallest_rotation(a, b)
        np.testing.assert_allclose(turn @ a / np.linalg.norm(a), b / np.linalg.norm(b), atol=1e-12)
        between = np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))
        assert Rotation.from_matrix(turn).magnitude() == pytest.approx(between, abs=1e-9)


@pytest.mark.parametrize("axis", np.eye(3))
@pytest.mark.parametrize("lean", [0.0, 1e-9, 1e-7, 1e-5])
def test_opposite_directions_turn_by_half_a_circle(axis: np.ndarray, lean: float) -> None:
    source = -axis + lean * np.roll(axis, 1)
    turn = smallest_rotation(source, axis)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(turn) == pytest.approx(1)
    np.testing.assert_allclose(turn @ source / np.linalg.norm(source), axis, atol=1e-6)


def test_only_a_rotation_and_a_translation_are_rigid() -> None:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=2).as_matrix()
    pose[:3, 3] = [4, 5, 6]
    assert is_rigid(pose)
    for change in ("mirror", "scale", "shear", "nan", "row"):
        bad = pose.copy()
        if change == "mirror":
            bad[:3, 0] *= -1
        elif change == "scale":
            bad[:3, :3] *= 1.01
        elif change == "shear":
            bad[0, 1] += 0.1
        elif change == "nan":
            bad[1, 3] = np.nan
        else:
            bad[3, 0] = 0.1
        assert not is_rigid(bad), change
    assert not is_rigid(np.eye(3))
