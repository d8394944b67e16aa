"""Scans of navigation graphs as arrays, by id from a folder or a project, read on first use.

Numbers have 32 bits where Matterport3DSimulator's do (glm), so that almost level edges are sorted in an equal order.
Unlike in Matterport3DSimulator, a process may have any number of graphs, unused scans are not read, and a changed file
is read again.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError, value_text
from nvsim.files.opening import is_number, read_json, read_text
from nvsim.r2r.simulator.conventions import InvalidValue, UnknownScan

if TYPE_CHECKING:
    Ways = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32], NDArray[np.float64]]
    """`starts`, `neighbor`, `towards`, and `reach` of a Scan, or of several joined scans."""

CANONICAL = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""(3, 3) camera-to-world rotation of a level pose that faces +y."""
_LARGEST_LIST = 1 << 24  # largest size of a scans.txt in bytes
_LOCK = threading.Lock()
_READ: WeakValueDictionary[tuple[str, int, int], Scan] = WeakValueDictionary()
"""(path, time, size) -> scan. Agents often open a simulator for every environment of a batch with the same files."""


@dataclass(frozen=True, eq=False)
class Scan:
    """One scan as arrays. A way is one direction of an edge.

    id         scan id
    ids        viewpoint ids in the order of the file, including excluded ones
    included   (n,) bool
    position   (n, 3) float32, meters, world
    rotation   (n, 3, 3) float64, camera-to-world
    starts     (n + 1,) int64, the ways of viewpoint i are starts[i] to starts[i + 1]
    neighbor   (m,) int64, end of each way, ascending for each viewpoint; only included viewpoints
    towards    (m, 4) float32, x and y of the way in meters, and x and y of its unit direction seen from above: NaN for
               a neighbor exactly above or below
    reach      (m, 2) float64, meters and radians above the horizon
    """

    id: str
    ids: tuple[str, ...]
    included: NDArray[np.bool_]
    position: NDArray[np.float32]
    rotation: NDArray[np.float64]
    starts: NDArray[np.int64]
    neighbor: NDArray[np.int64]
    towards: NDArray[np.float32]
    reach: NDArray[np.float64]

    @cached_property
    def index_of(self) -> dict[str, int]:
        """Viewpoint id -> index; for duplicate ids the first."""
        return {id: i for i, id in reversed(list(enumerate(self.ids)))}

    def index(self, viewpoint: str) -> int:
        """Returns the index of a start viewpoint. Raises InvalidValue if it does not exist or is excluded."""
        found = self.index_of.get(viewpoint)
        if found is None:
            raise InvalidValue(f"MatterSim: Could not find viewpointId: {viewpoint}, is viewpoint id valid?")
        if not self.included[found]:
            raise InvalidValue(f"MatterSim: ViewpointId: {viewpoint}, is excluded from the connectivity graph.")
        return found


def scan_of(
    id: str,
    ids: Sequence[str],
    included: NDArray[np.bool_],
    pose: NDArray[np.float64],  # (n, 4, 4) camera-to-world
    free: NDArray[np.bool_],  # (n, n) whether a way leads from the row's viewpoint to the column's
) -> Scan:
    """Returns a scan of n viewpoints with poses (n, 4, 4). Ways from a viewpoint to itself are ignored."""
    free = free & included[None, :]
    np.fill_diagonal(free, False)
    start, neighbor = np.nonzero(free)
    starts = np.zeros(len(ids) + 1, np.int64)
    np.cumsum(free.sum(axis=1), out=starts[1:])
    position = pose[:, :3, 3].astype(np.float32)
    towards, reach = directions_and_distances(position[start], position[neighbor])
    rotation = np.ascontiguousarray(pose[:, :3, :3], np.float64)
    return Scan(id, tuple(ids), included, position, rotation, starts, neighbor, towards, reach)


def level_scan(
    id: str,
    ids: Sequence[str],
    included: NDArray[np.bool_],
    positions: NDArray[np.float64],  # (n, 3) meters, world
    edges: NDArray[np.int64],  # (m, 2) indices into ids, traversable in both directions
) -> Scan:
    """Returns a scan of viewpoints at `positions` (n, 3) that are all level and face +y."""
    free = np.zeros((len(ids), len(ids)), bool)
    free[edges[:, 0], edges[:, 1]] = free[edges[:, 1], edges[:, 0]] = True
    pose = np.tile(np.eye(4), (len(ids), 1, 1))
    pose[:, :3, :3] = CANONICAL
    pose[:, :3, 3] = positions
    return scan_of(id, ids, included, pose, free)


def directions_and_distances(
    start: NDArray[np.float32], end: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Returns `towards` (m, 4) and `reach` (m, 2) of a Scan, for ways from `start` to `end` (m, 3), meters."""
    offset = (end - start).reshape(-1, 3).astype(np.float32)
    x, y, z = offset.T
    flat_square = x * x + y * y
    flat = np.sqrt(flat_square)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = np.float32(1) / flat
        towards = np.stack([x, y, x * unit, y * unit], axis=1).astype(np.float32)
    reach = np.stack([np.sqrt(flat_square + z * z), np.arctan2(z.astype(np.float64), flat.astype(np.float64))], axis=1)
    return towards, reach.astype(np.float64)


def read_scan(path: Path, id: str) -> Scan:
    """Reads the scan of a connectivity file as Matterport3DSimulator does.

    It reads only image_id, included, pose and unobstructed. Ways may exist in one direction only, and poses may be
    tilted. Raises InvalidValue if a value is invalid (Matterport3DSimulator reads out of bounds) or the file is
    unreadable.
    """
    try:
        entries = read_json(path, "a connectivity file", "export the scan again")
    except InputError as error:
        raise InvalidValue(str(error)) from error
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InvalidValue(f"{path} is not a list of viewpoints; export the scan again.")
    count = len(entries)
    ids: list[str] = []
    included = np.zeros(count, bool)
    pose = np.zeros((count, 4, 4))
    free = np.zeros((count, count), bool)
    for i, entry in enumerate(entries):
        where = f"{path}, entry {i}"
        name = entry.get("image_id")
        if not isinstance(name, str) or not name or "/" in name or "\0" in name:
            raise InvalidValue(f"{where}: image_id is {value_text(name)}; it must be a name without slash.")
        ids.append(name)
        included[i] = bool(entry.get("included"))
        pose[i] = _numbers(entry.get("pose"), 16, f"{where}: pose").reshape(4, 4)
        free[i] = _numbers(entry.get("unobstructed"), count, f"{where}: unobstructed") != 0
        if abs(np.linalg.det(pose[i, :3, :3])) < 0.5:
            raise InvalidValue(f"{where}: the first three columns of pose are not a rotation; export the scan again.")
    return scan_of(id, ids, included, pose, free)


def _numbers(values: Any, count: int, where: str) -> NDArray[np.float64]:
    if not isinstance(values, list) or len(values) != count:
        found = f"{len(values)} values" if isinstance(values, list) else value_text(values)
        raise InvalidValue(f"{where} has {found} and must be a list of {count}; export the scan again.")
    for value in values:
        if not isinstance(value, bool) and not is_number(value):
            raise InvalidValue(f"{where} has {value_text(value)}, which is not a finite number; export the scan again.")
    return np.array(values, np.float64)


class Scans(Protocol):
    """The source of a simulator's scans."""

    def scan(self, id: str) -> Scan:
        """Returns a scan. Raises UnknownScan, or InvalidValue if its file is unusable."""

    def scan_ids(self) -> tuple[str, ...]:
        """Returns the ids of all scans. Raises InvalidValue if the list is unreadable."""


class NavGraph:
    """The graphs of a folder: scans.txt, and `<scan>_connectivity.json` for each scan that it lists. Thread-safe."""

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self._held: dict[str, Scan] = {}  # used scans, kept until their files change
        self._listed: tuple[tuple[int, int], tuple[str, ...]] | None = None

    def scan_ids(self) -> tuple[str, ...]:
        path = self.folder / "scans.txt"
        stamp = _stamp(path)
        if stamp is None:
            raise InvalidValue(f"MatterSim: Could not open list of scans at: {path}, is path valid?")
        if self._listed is None or self._listed[0] != stamp:
            try:
                text = read_text(path, "a list of scans", "export the scans again", _LARGEST_LIST)
            except InputError as error:
                raise InvalidValue(str(error)) from error
            self._listed = stamp, tuple(dict.fromkeys(text.split()))
        return self._listed[1]

    def scan(self, id: str) -> Scan:
        if id not in self.scan_ids():
            raise UnknownScan(f"There is no scan {id!r} in {self.folder / 'scans.txt'} (map::at); check its id.")
        path = self.folder / f"{id}_connectivity.json"
        stamp = _stamp(path)
        if stamp is None:
            raise InvalidValue(f"MatterSim: Could not open navigation graph file: {path}, is path valid?")
        key = (os.path.abspath(path), *stamp)
        with _LOCK:
            found = _READ.get(key)
            if found is None:
                found = _READ[key] = read_scan(path, id)
            self._held[id] = found
        return found


class OneScan:
    """A source with one given scan."""

    def __init__(self, scan: Scan) -> None:
        self._scan = scan

    def scan_ids(self) -> tuple[str, ...]:
        return (self._scan.id,)

    def scan(self, id: str) -> Scan:
        if id != self._scan.id:
            raise UnknownScan(f"There is only the scan {self._scan.id!r} and no {id!r} (map::at); check its id.")
        return self._scan


class JoinedScans:
    """Several scans with concatenated arrays, so that a batch over them is one loop.

    scans      scan id -> scan, in order
    first      scan id -> the row of its first viewpoint
    """

    def __init__(self, scans: Iterable[Scan]) -> None:
        self.scans = {scan.id: scan for scan in scans}
        rows = np.cumsum([0, *(len(s.ids) for s in self.scans.values())])
        edges = np.cumsum([0, *(len(s.neighbor) for s in self.scans.values())])
        each = list(self.scans.values())
        self.first = dict(zip(self.scans, rows[:-1].tolist()))
        self.ids = [id for s in each for id in s.ids]
        self.indices = [i for s in each for i in range(len(s.ids))]
        self.positions = np.concatenate([s.position for s in each]).astype(np.float64).tolist()
        self.ways: Ways = (
            np.concatenate([*(s.starts[:-1] + e for s, e in zip(each, edges)), edges[-1:]]),
            np.concatenate([s.neighbor + r for s, r in zip(each, rows)]),
            np.concatenate([s.towards for s in each]),
            np.concatenate([s.reach for s in each]),
        )

    def contains(self, scans: Iterable[Scan]) -> bool:
        return all(self.scans.get(s.id) is s for s in scans)


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size
