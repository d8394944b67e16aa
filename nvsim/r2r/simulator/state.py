"""The state of each environment of a batch, and the locations that it can move to.

The numbers of a batch are in arrays, and objects are made of them on access. As in Matterport3DSimulator, a state
changes with its environment: copy the values that you keep. Images are never overwritten.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.simulator.looking import navigable
from nvsim.r2r.simulator.scan import Joined, ways


class ViewPoint:
    """A position in a scan.

    viewpointId    "" for a position that is not a viewpoint
    ix             index in the connectivity file, -1 for a position that is not a viewpoint
    x, y, z        meters, world; `point` is the three of them
    rel_heading    radians to the right of the camera's heading
    rel_elevation  radians above the camera's elevation
    rel_distance   meters
    """

    __slots__ = ("ix", "rel_distance", "rel_elevation", "rel_heading", "viewpointId", "x", "y", "z")

    def __init__(
        self,
        viewpointId: str,
        ix: int,
        position: tuple[float, float, float] | list[float],
        relative: tuple[float, float, float] | list[float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.viewpointId, self.ix = viewpointId, ix
        self.x, self.y, self.z = position
        self.rel_heading, self.rel_elevation, self.rel_distance = relative

    @property
    def point(self) -> list[float]:
        return [self.x, self.y, self.z]

    def __repr__(self) -> str:
        return f"ViewPoint({self.viewpointId!r}, ix={self.ix}, point={self.point})"


@dataclass(eq=False)
class Batch:
    """The state of the B environments of a batch, as arrays.

    size                        B
    joined                      the scans of the environments, None before the first episode
    scan                        scan id of each
    place                       (B,) rows of `joined`
    beside                      environment -> its position outside the graph, with its ways to viewpoints
    heading, elevation          (B,) radians
    view                        (B,) 0 to 35 if views are discrete
    step                        (B,) actions since the episode began
    where, relative, count      from `looking.navigable`
    rgb, depth                  the images of each
    changed                     incremented with every change of the above
    """

    size: int
    rgb: list[NDArray[np.uint8]]
    depth: list[NDArray[np.uint16]]
    joined: Joined | None = None
    scan: list[str] = field(default_factory=list)
    beside: dict[int, Beside] = field(default_factory=dict)
    changed: int = 0

    def __post_init__(self) -> None:
        self.scan = [""] * self.size
        self.place = np.zeros(self.size, np.int64)
        self.heading, self.elevation = np.zeros(self.size), np.zeros(self.size)
        self.view, self.step = np.zeros(self.size, np.int64), np.zeros(self.size, np.int64)
        self.where = np.zeros((self.size, 1), np.int64)
        self.relative = np.zeros((self.size, 1, 3))
        self.count = np.zeros(self.size, np.int64)

    def look_around(self, restricted: bool, least_cosine: float) -> None:
        """Updates the navigable locations of every environment."""
        joined = self.joined
        assert joined is not None
        if self.where.shape[1] <= joined.most:
            self.where = np.zeros((self.size, joined.most + 1), np.int64)
            self.relative = np.zeros((self.size, joined.most + 1, 3))
        graph = joined.starts, joined.neighbour, joined.towards, joined.reach
        found = self.where, self.relative, self.count
        navigable(self.place, self.heading, self.elevation, *graph, restricted, least_cosine, *found)
        for b, beside in self.beside.items():
            here = slice(b, b + 1)
            where = np.zeros((1, len(beside.neighbour) + 1), np.int64)
            relative = np.zeros((1, len(beside.neighbour) + 1, 3))
            starts = np.array([0, len(beside.neighbour)], np.int64)
            navigable(
                np.zeros(1, np.int64),
                self.heading[here],
                self.elevation[here],
                starts,
                beside.neighbour,
                beside.towards,
                beside.reach,
                restricted,
                least_cosine,
                where,
                relative,
                self.count[here],
            )
            beside.where, beside.relative = where[0], relative[0]
        self.changed += 1

    def beside_after(self, chosen: NDArray[np.int64], places: NDArray[np.int64]) -> dict[int, Beside]:
        """Returns the environments that stay outside the graph after moving to the `chosen` locations (B,).

        `places` (B,) of all environments that are or were outside the graph is corrected.
        """
        still = {}
        for b, beside in self.beside.items():
            if chosen[b] == 0:
                still[b], places[b] = beside, self.place[b]
            else:
                places[b] = beside.where[chosen[b]]
        return still


@dataclass(eq=False)
class Beside:
    """A position outside the graph, (3,) float64 meters, world, with its ways.

    The ways are as in a Scan, and the neighbors are rows of the joined scans.
    """

    position: NDArray[np.float64]
    neighbour: NDArray[np.int64]
    towards: NDArray[np.float32]
    reach: NDArray[np.float64]
    where: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, np.int64))
    relative: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 3)))

    @staticmethod
    def at(position: NDArray[np.float64], rows: list[int], joined: Joined) -> Beside:
        """Returns a position (3,), meters, world, with free ways to the viewpoints of some rows."""
        ends = np.array([joined.positions[row] for row in rows], np.float32).reshape(-1, 3)
        towards, reach = ways(np.tile(position.astype(np.float32), (len(rows), 1)), ends)
        return Beside(position, np.array(rows, np.int64), towards, reach)


class SimState:
    """The state of one environment. All values except the images are read on access."""

    __slots__ = ("_at", "_batch", "_index", "_locations")

    def __init__(self, batch: Batch, index: int) -> None:
        self._batch, self._index = batch, index
        self._at, self._locations = -1, [ViewPoint("", 0, (0.0, 0.0, 0.0))]

    @property
    def scanId(self) -> str:
        return self._batch.scan[self._index]

    @property
    def step(self) -> int:
        """Number of actions since the episode began."""
        return int(self._batch.step[self._index])

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """(height, width, 3) uint8 BGR."""
        return self._batch.rgb[self._index]

    @property
    def depth(self) -> NDArray[np.uint16]:
        """(height, width, 1) uint16 depth along the optical axis in 0.25 mm, 0 if unknown."""
        return self._batch.depth[self._index]

    @property
    def heading(self) -> float:
        """Radians in [0, 2 pi); 0 is +y, positive turns right."""
        return float(self._batch.heading[self._index])

    @property
    def elevation(self) -> float:
        """Radians above the horizon."""
        return float(self._batch.elevation[self._index])

    @property
    def viewIndex(self) -> int:
        """0 to 35 if viewing angles are discrete: from 0 down, from 12 level, from 24 up."""
        return int(self._batch.view[self._index])

    @property
    def location(self) -> ViewPoint:
        batch, b = self._batch, self._index
        if batch.joined is None:
            return self._locations[0]
        if b in batch.beside:
            return ViewPoint("", -1, batch.beside[b].position.tolist())
        return _viewpoint(batch.joined, int(batch.place[b]), [0.0, 0.0, 0.0])

    @property
    def navigableLocations(self) -> list[ViewPoint]:
        """The locations for `makeAction`: first the current one, then by their angle from the image center."""
        batch = self._batch
        if batch.joined is None:
            return []
        if self._at != batch.changed:
            self._at, self._locations = batch.changed, _locations(batch, batch.joined, self._index)
        return self._locations

    def __repr__(self) -> str:
        return f"SimState({self.scanId!r}, {self.location!r}, {self.heading:.3f}, {self.elevation:.3f})"


def _locations(batch: Batch, joined: Joined, b: int) -> list[ViewPoint]:
    n = int(batch.count[b])
    beside = batch.beside.get(b)
    if beside is not None:
        rows, relative = beside.where[1:n].tolist(), beside.relative[1:n].tolist()
        first = ViewPoint("", -1, beside.position.tolist())
        return [first, *(_viewpoint(joined, row, r) for row, r in zip(rows, relative, strict=True))]
    rows, relative = batch.where[b, :n].tolist(), batch.relative[b, :n].tolist()
    return [_viewpoint(joined, row, r) for row, r in zip(rows, relative, strict=True)]


def _viewpoint(joined: Joined, row: int, relative: list[float]) -> ViewPoint:
    return ViewPoint(joined.ids[row], joined.indices[row], joined.positions[row], relative)


def position_of(batch: Batch, b: int) -> NDArray[np.float64]:
    """Returns the position (3,), meters, world, of an environment."""
    assert batch.joined is not None
    return batch.beside[b].position if b in batch.beside else np.array(batch.joined.positions[int(batch.place[b])])


def black(width: int, height: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Returns black images (height, width, 3) uint8 and (height, width, 1) uint16."""
    return np.zeros((height, width, 3), np.uint8), np.zeros((height, width, 1), np.uint16)
