"""The trajectory during pose computation: a small file that the child process replaces after each step, for display."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic
from nvsim.files.reading import reading
from nvsim.files.stored_arrays import read_arrays

if TYPE_CHECKING:
    import pycolmap

GROWING = "trajectory.npz"
_STEP = 0.25  # meters: usual distance between two chosen frames
_BESIDE = 2.0  # meters between two pieces


@dataclass(frozen=True, eq=False)
class GrowingTrajectory:
    """Cameras that have a pose so far. The unit is estimated from a usual walking step. Pieces are placed side by side.

    positions  (N, 3) float64, meters, z up, in order of time within each piece
    frame      (N,) int64, number of the chosen frame
    piece      (N,) int64, from 0, the largest first
    """

    positions: NDArray[np.float64]
    frame: NDArray[np.int64]
    piece: NDArray[np.int64]


def growing_trajectory(models: Sequence[pycolmap.Reconstruction]) -> GrowingTrajectory:
    """The camera positions of reconstructions, the largest first, each as one piece."""
    from nvsim.capture.alignment import find_up
    from nvsim.geometry.rotation import smallest_rotation

    places, frames, pieces, right = [np.zeros((0, 3))], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], 0.0
    for index, model in enumerate(models):
        numbers = sorted(model.reg_image_ids())
        if not numbers:
            continue
        poses = np.tile(np.eye(4), (len(numbers), 1, 1))
        for pose, number in zip(poses, numbers, strict=True):
            pose[:3] = model.images[number].cam_from_world().inverse().matrix()
        own = poses[:, :3, 3] @ smallest_rotation(find_up(poses)[0], np.array([0.0, 0.0, 1.0])).T
        steps = np.linalg.norm(np.diff(own, axis=0), axis=1)
        usual = float(np.median(steps)) if len(steps) else 0.0
        own = (own - own.mean(axis=0)) * (_STEP / usual if usual > 1e-9 else 1.0)
        if index:
            own[:, 0] += right + _BESIDE - own[:, 0].min()
        right = max(right, float(own[:, 0].max()))
        places.append(own)
        frames.append(np.array(numbers, np.int64))
        pieces.append(np.full(len(numbers), index))
    return GrowingTrajectory(np.concatenate(places), np.concatenate(frames), np.concatenate(pieces))


def write_growing(models: Sequence[pycolmap.Reconstruction], folder: Path) -> None:
    """Writes the file in `folder`. Raises InputError if writing fails."""
    found, data = growing_trajectory(models), io.BytesIO()
    np.savez(data, positions=found.positions, frame=found.frame, piece=found.piece)
    atomic.write_bytes(folder / GROWING, data.getvalue())


def read_growing(path: Path) -> GrowingTrajectory:
    """Reads the file. Raises InputError if it is missing or damaged."""
    wanted = {"positions": ("f", 2), "frame": ("i", 1), "piece": ("i", 1)}
    what, then = "a growing trajectory", "compute the poses again"
    arrays = read_arrays(path, what, wanted, then)
    positions, frame, piece = arrays["positions"].astype(np.float64), arrays["frame"], arrays["piece"]
    with reading(path, what, then):
        if positions.shape != (len(frame), 3) or len(piece) != len(frame) or not (np.abs(positions) < 1e6).all():
            raise ValueError("its arrays do not match")
    return GrowingTrajectory(positions, frame.astype(np.int64), piece.astype(np.int64))
