"""Scans as arrays for agents in training: candidates, angles and features of every viewpoint.

A step of a batch is a lookup. The arrays are a closed form of the simulator's states; no images are rendered.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.features.feature_reading import Key
from nvsim.r2r.tasks.shortest import ShortestPaths

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]
STOP = 0
"""The slot of stopping; candidates are in the slots from 1 on."""


@dataclass(frozen=True, eq=False)
class Within:
    """A scan in the world: the row of its `first` viewpoint, and its shortest paths by rows of its own."""

    first: int
    shortest: ShortestPaths


@dataclass(frozen=True, eq=False)
class Onward:
    """The shortest paths to a goal, in the scan whose first row is `first`.

    next     (n,) row of the next viewpoint on the shortest path; -1 at the goal and if there is no path
    metres   (n,) float64, meters to the goal along the graph
    """

    first: int
    next: Int64
    metres: NDArray[np.float64]


@dataclass(eq=False)
class World:
    """The N viewpoints of all scans in one array, with up to K candidates each.

    keys       (N) scan and viewpoint id
    row        scan and viewpoint id -> row
    target     (N, K) rows; -1 for slots without a candidate
    heading    (N, K) float32 radians, world: 0 is +y, positive turns right
    elevation  (N, K) float32 radians above the horizon
    distance   (N, K) float32 meters
    seen       (N, K) rows of `features`: the view that shows the candidate best
    features   (M, F) float32, each row with mean 0 and standard deviation 1; row 0 is zeros
    panorama   (N, 36) rows of `features`; None without panoramas
    scans      by scan id
    """

    keys: list[Key]
    row: Mapping[Key, int]
    target: Int64
    heading: Float32
    elevation: Float32
    distance: Float32
    seen: Int64
    features: Float32
    panorama: Int64 | None
    scans: Mapping[str, Within]
    _onward: dict[int, Onward] = field(default_factory=dict)

    @property
    def width(self) -> int:
        """Numbers per view."""
        return self.features.shape[1]

    def onward(self, goal: int) -> Onward:
        """Returns the shortest paths to the row `goal`, with ties as in nvsim.r2r.tasks.shortest."""
        if goal not in self._onward:
            scan = self.scans[self.keys[goal][0]]
            tree = scan.shortest.tree(goal - scan.first)
            after = np.where(tree.before >= 0, tree.before + scan.first, -1)
            self._onward[goal] = Onward(scan.first, after, tree.metres)
        return self._onward[goal]

    def teacher(self, here: Int64, goals: Int64) -> Int64:
        """Returns (B,) int64 the slot on the shortest path from rows `here` (B,) to rows `goals` (B,).

        It is STOP at the goal, and -1 if no candidate is on the path.
        """
        found = np.full(len(here), -1, np.int64)
        for i, (at, goal) in enumerate(zip(here.tolist(), goals.tolist())):
            if at == goal:
                found[i] = STOP
                continue
            onward = self.onward(goal)
            slots = np.flatnonzero(self.target[at] == onward.next[at - onward.first])
            if onward.next[at - onward.first] >= 0 and len(slots):
                found[i] = 1 + slots[0]
        return found

    def after(self, here: Int64, slots: Int64) -> Int64:
        """Returns (B,) the rows after taking `slots` (B,) from rows `here` (B,)."""
        return np.where(slots == STOP, here, self.target[here, slots - 1])

    def metres(self, here: Int64, goals: Int64) -> NDArray[np.float64]:
        """Returns (B,) meters from rows `here` (B,) to rows `goals` (B,) along the graph."""
        each = zip(here.tolist(), goals.tolist())
        return np.array([(o := self.onward(goal)).metres[at - o.first] for at, goal in each])
