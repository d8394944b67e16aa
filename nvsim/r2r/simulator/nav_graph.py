"""The navigation graphs of a folder or of a project: scans by id, read on first use.

Unlike in Matterport3DSimulator, a process may have any number of them, unused scans are not read, and a changed file is
read again.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol
from weakref import WeakValueDictionary

import numpy as np

from nvsim.errors import InputError
from nvsim.files.regular import read_text
from nvsim.graph.types import NavGraph as Graph
from nvsim.r2r.simulator.errors import InvalidValue, UnknownScan
from nvsim.r2r.simulator.scan import Scan, level_scan, read_scan

_LARGEST_LIST = 1 << 24  # largest size of a scans.txt in bytes
_LOCK = threading.Lock()
_READ: WeakValueDictionary[tuple[str, int, int], Scan] = WeakValueDictionary()
"""(path, time, size) -> scan. Agents often open a simulator for every environment of a batch with the same files."""


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


class GraphOfProject(OneScan):
    """The graph of a project as a scan. All viewpoints are level and face +y."""

    def __init__(self, graph: Graph, id: str) -> None:
        viewpoints = list(graph.viewpoints.values())
        index = {v.id: i for i, v in enumerate(viewpoints)}
        edges = np.array([(index[a], index[b]) for a, b in graph.edges], np.int64).reshape(-1, 2)
        positions = np.array([v.position for v in viewpoints]).reshape(-1, 3)
        included = np.array([v.included for v in viewpoints], bool)
        super().__init__(level_scan(id, list(index), included, positions, edges))


class Joined:
    """Several scans with concatenated arrays, so that a batch over them is one loop.

    scans      scan id -> scan, in order
    first      scan id -> the row of its first viewpoint
    """

    def __init__(self, scans: Iterable[Scan]) -> None:
        self.scans = {scan.id: scan for scan in scans}
        rows = np.cumsum([0, *(len(s.ids) for s in self.scans.values())])
        edges = np.cumsum([0, *(len(s.neighbour) for s in self.scans.values())])
        each = list(self.scans.values())
        self.first = dict(zip(self.scans, rows[:-1].tolist(), strict=True))
        self.ids = [id for s in each for id in s.ids]
        self.indices = [i for s in each for i in range(len(s.ids))]
        self.positions = np.concatenate([s.position for s in each]).astype(np.float64).tolist()
        self.starts = np.concatenate([*(s.starts[:-1] + e for s, e in zip(each, edges)), edges[-1:]])
        self.neighbour = np.concatenate([s.neighbour + r for s, r in zip(each, rows)])
        self.towards = np.concatenate([s.towards for s in each])
        self.reach = np.concatenate([s.reach for s in each])
        self.most = int(np.diff(self.starts).max(initial=0))

    def holds(self, scans: Iterable[Scan]) -> bool:
        return all(self.scans.get(s.id) is s for s in scans)


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size
