"""Stores a cut of the trajectory into submaps in a separate file. Floors and models keep their own cut when a newer one
is made."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.files.atomic import replacing
from nvsim.files.reading import reading
from nvsim.files.stored_arrays import read_arrays
from nvsim.submaps.types import Submap

_MOST = 1 << 24  # frames and submaps
_FARTHEST = 1e9  # meters


def save_cut(path: Path, submaps: Sequence[Submap]) -> None:
    """Writes a cut to `path`. Raises InputError if the disk reports an error."""
    rows = [(s.index, f, f in core) for s in submaps for core in [set(s.core)] for f in s.frames]
    table = np.array(rows, np.int64).reshape(-1, 3)
    positions = np.concatenate([s.positions for s in submaps]) if submaps else np.zeros((0, 3))
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, rows=table, positions=positions)


def load_cut(path: Path) -> tuple[Submap, ...]:
    """Reads a cut that `save_cut` wrote. Raises InputError if it is missing or damaged."""
    what, then = "a cut into submaps", "run `nvsim submaps` again"
    data = read_arrays(path, what, {"rows": ("iu", 2), "positions": ("f", 2)}, then)
    with reading(path, what, then):
        rows, positions = data["rows"].astype(np.int64), data["positions"].astype(np.float64)
        if (
            rows.shape[1] != 3
            or positions.shape != (int((rows[:, 2] == 1).sum()), 3)
            or not (np.abs(positions) < _FARTHEST).all()
        ):
            raise InputError(f"{path} is not {what}: its rows and positions do not match; {then}.")
        if len(rows) and (rows.min() < 0 or rows.max() > _MOST or rows[:, 2].max() > 1):
            raise InputError(f"{path} is not {what}: it names frames that do not exist; {then}.")
        result: list[Submap] = []
        at = 0
        for index in dict.fromkeys(rows[:, 0].tolist()):
            own = rows[rows[:, 0] == index]
            core = tuple(own[own[:, 2] == 1, 1].tolist())
            result.append(Submap(int(index), core, tuple(own[:, 1].tolist()), positions[at : at + len(core)]))
            at += len(core)
        return tuple(result)


def same_cut(a: Sequence[Submap], b: Sequence[Submap]) -> bool:
    """Whether two cuts have equal submaps with equal camera positions."""
    return len(a) == len(b) and all(
        (x.index, x.core, x.frames) == (y.index, y.core, y.frames) and np.allclose(x.positions, y.positions, atol=1e-9)
        for x, y in zip(a, b, strict=True)
    )
