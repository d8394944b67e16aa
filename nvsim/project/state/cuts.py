"""Stores a cut of the trajectory into submaps as rows and in a file.

Floors and models keep their own cut when a newer one is made. The file contains the names of the frames, because the
same frame has another number in another capture."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files import tables
from nvsim.files.reading import reading
from nvsim.files.stored_arrays import read_arrays, write_arrays
from nvsim.files.tables import COUNT, FLAG
from nvsim.submaps.split import Submap

_MOST = 1 << 24  # frames and submaps
_FARTHEST = 1e9  # meters


def save_cut(path: Path, submaps: Sequence[Submap], names: Sequence[str]) -> None:
    """Writes a cut of a capture whose frames have `names` to `path`. Raises InputError if the disk reports an error."""
    rows = [(s.index, f, f in core) for s in submaps for core in [set(s.core)] for f in s.frames]
    table = np.array(rows, np.int64).reshape(-1, 3)
    positions = np.concatenate([s.positions for s in submaps]) if submaps else np.zeros((0, 3))
    words = np.frombuffer("\n".join(names).encode(), np.uint8)
    write_arrays(path, {"rows": table, "positions": positions, "names": words})


class StoredCut(NamedTuple):
    """Submaps of a capture whose frames have `names`; without names, the cut is of an earlier version of NVSim."""

    submaps: tuple[Submap, ...]
    names: tuple[str, ...]

    def was_made_from(self, names: Sequence[str], positions: NDArray[np.float64]) -> bool:
        """Whether a capture with these frame `names` and camera `positions` (N, 3), meters, was cut."""
        return self.names in ((), tuple(names)) and all(
            max(s.core, default=-1) < len(positions) and np.allclose(positions[list(s.core)], s.positions, atol=1e-6)
            for s in self.submaps
        )

    def of_frames(self, names: Sequence[str]) -> tuple[Submap, ...]:
        """The submaps with the frame numbers of a capture whose frames have `names`, without frames that this capture
        does not have. Submaps without such a frame in their core are omitted."""
        own = self.names or tuple(names)
        if own == tuple(names) and all(max(s.frames, default=-1) < len(own) for s in self.submaps):
            return self.submaps
        number = {name: k for k, name in enumerate(names)}
        new = [number.get(name) for name in own]
        new += [None] * (1 + max((max(s.frames, default=-1) for s in self.submaps), default=-1) - len(new))
        result = []
        for s in self.submaps:
            core = sorted((k, row) for row, f in enumerate(s.core) if (k := new[f]) is not None)
            frames = sorted(k for f in s.frames if (k := new[f]) is not None)
            if core:
                positions = s.positions[[row for _, row in core]]
                result.append(Submap(s.index, tuple(k for k, _ in core), tuple(frames), positions))
        return tuple(result)


def load_cut(path: Path) -> StoredCut:
    """Reads a cut that `save_cut` wrote. Raises InputError if it is missing or damaged."""
    what, then = "a cut into submaps", "run `nvsim submaps` again"
    wanted = {"rows": ("iu", 2), "positions": ("f", 2), "names": ("u", 1)}
    data = read_arrays(path, what, wanted, then, frozenset(("names",)))
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
        words = data["names"].astype(np.uint8).tobytes().decode() if "names" in data else ""
        return StoredCut(tuple(result), tuple(words.split("\n")) if words else ())


def same_cut(a: Sequence[Submap], b: Sequence[Submap]) -> bool:
    """Whether two cuts have equal submaps with equal camera positions."""
    return len(a) == len(b) and all(
        (x.index, x.core, x.frames) == (y.index, y.core, y.frames) and np.allclose(x.positions, y.positions, atol=1e-9)
        for x, y in zip(a, b, strict=True)
    )


def read_rows(
    c: sqlite3.Connection, database: Path, positions_of: Callable[[], NDArray[np.float64]]
) -> tuple[Submap, ...]:
    """The newest cut; empty if there is none. `positions_of` returns the camera positions (N, 3) of the capture. Raises
    InputError if the rows do not match the capture."""
    columns = {"submap": COUNT, "frame": COUNT, "core": FLAG}
    rows = tables.read(c, database, "submap_frames", columns, "ORDER BY submap, frame")
    if not rows:
        return ()
    positions = positions_of()
    for submap, frame, _ in rows:
        if submap < 0 or not 0 <= frame < len(positions):
            raise InputError(
                f"{database}: submap {submap} has frame {frame}, and the capture has {len(positions)}; "
                "run `nvsim submaps --project` again."
            )
    result = []
    for index in sorted({row[0] for row in rows}):
        frames = tuple(f for s, f, _ in rows if s == index)
        core = tuple(f for s, f, c in rows if s == index and c)
        result.append(Submap(index, core, frames, positions[list(core)]))
    return tuple(result)


def write_rows(c: sqlite3.Connection, submaps: Sequence[Submap]) -> None:
    """Replaces the rows of the newest cut. Call it inside a transaction."""
    c.execute("DELETE FROM submap_frames")
    rows = [(s.index, f, int(f in core)) for s in submaps for core in [set(s.core)] for f in s.frames]
    c.executemany("INSERT INTO submap_frames VALUES (?, ?, ?)", rows)
