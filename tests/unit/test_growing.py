"""The trajectory that is shown while poses are computed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from known_reconstruction import facing, pose, reconstruction, seen_from

from nvsim.errors import InputError
from nvsim.reconstruction.growing_trajectory import GROWING, read_growing, write_growing


def walk(count: int, step: float) -> pycolmap.Reconstruction:
    """Along x, with z up and the camera level."""
    poses = {k + 1: pose(facing(np.array([0.0, 1.0, 0.0])), np.array([step * k, 0.0, 0.0])) for k in range(count)}
    points = np.random.default_rng(0).uniform((-2, 2, -1), (4, 4, 1), (60, 3))
    return reconstruction(poses, points, *seen_from(poses, points))


def test_each_piece_has_steps_of_a_usual_walk_and_a_place_of_its_own(tmp_path: Path) -> None:
    write_growing([walk(12, 0.1), walk(8, 3.0)], tmp_path)
    found = read_growing(tmp_path / GROWING)
    assert found.piece.tolist() == [0] * 12 + [1] * 8 and found.frame.tolist() == [*range(1, 13), *range(1, 9)]
    for piece in (0, 1):
        steps = np.diff(found.positions[found.piece == piece], axis=0)
        assert np.linalg.norm(steps, axis=1) == pytest.approx(0.25)
        assert steps[:, 2] == pytest.approx(0, abs=1e-6)
    assert found.positions[12:, 0].min() == pytest.approx(found.positions[:12, 0].max() + 2)


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / GROWING
    np.savez(path, positions=np.zeros((3, 3)), frame=np.zeros(2, int), piece=np.zeros(2, int))
    with pytest.raises(InputError, match="trajectory.npz"):
        read_growing(path)
    write_growing([], tmp_path)
    assert len(read_growing(path).positions) == 0
