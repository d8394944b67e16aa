"""The scores of camera poses: a known similarity is undone, and known errors are reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.benchmarks.trajectory_scores import read_poses, score


def _trajectory(count: int = 40) -> NDArray[np.float64]:
    """(count, 4, 4) camera-to-world matrices along a bent way of a few meters."""
    rng = np.random.default_rng(2)
    poses = np.tile(np.eye(4), (count, 1, 1))
    s = np.linspace(0, 1, count)
    poses[:, :3, 3] = np.column_stack([9 * s, 3 * np.sin(4 * s), 1.4 + 0.02 * rng.standard_normal(count)])
    poses[:, :3, :3] = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.05, (count, 3)), axis=0)).as_matrix()
    return poses


def _moved(
    poses: NDArray[np.float64], scale: float, turn: NDArray[np.float64], shift: list[float]
) -> NDArray[np.float64]:
    out = poses.copy()
    out[:, :3, :3] = turn @ poses[:, :3, :3]
    out[:, :3, 3] = scale * poses[:, :3, 3] @ turn.T + shift
    return out


def test_a_known_similarity_is_undone_exactly() -> None:
    true = _trajectory()
    turn = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
    ours = _moved(true, 0.07, turn, [3.0, -2.0, 11.0])
    scores = score(ours, true)
    assert scores.position_max < 1e-9 and scores.rotation_median < 1e-9 and scores.relative_max < 1e-9
    assert scores.far == 0
    assert scores.extent == pytest.approx(np.linalg.norm(np.ptp(true[:, :3, 3], axis=0)))


def test_a_mirrored_trajectory_is_not_mirrored_back() -> None:
    true = _trajectory()
    ours = true.copy()
    ours[:, 1, 3] *= -1
    assert score(ours, true).position_max > 0.01


def test_one_camera_that_is_off_counts_as_far_and_turned() -> None:
    true = _trajectory(400)
    ours = true.copy()
    ours[200, 2, 3] += 1.0
    ours[200, :3, :3] = ours[200, :3, :3] @ Rotation.from_rotvec([0, np.radians(5), 0]).as_matrix()
    scores = score(ours, true)
    assert scores.far == 1
    assert scores.position_max == pytest.approx(1.0, abs=0.02)
    assert scores.position_median < 0.02
    assert scores.relative_max == pytest.approx(5.0, abs=1e-6)
    assert scores.rotation_median < 0.2


def test_too_few_or_coinciding_cameras_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 3"):
        score(_trajectory(2), _trajectory(2))
    with pytest.raises(ValueError, match="coincide"):
        score(np.tile(np.eye(4), (5, 1, 1)), _trajectory(5))


def test_rounded_rotations_are_read_as_rotations(tmp_path: Path) -> None:
    pose = _trajectory()[7]
    numbers = " ".join(f"{v:.4f}" for v in pose.ravel())
    (tmp_path / "poses.txt").write_text(f"# frame, matrix\n7 {numbers}\n")
    read = read_poses(tmp_path / "poses.txt")
    assert list(read) == [7]
    assert read[7][:3, :3] @ read[7][:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert read[7] == pytest.approx(pose, abs=1e-3)
