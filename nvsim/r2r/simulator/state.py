"""The state of each environment of a batch, and the locations that it can move to.

The numbers of a batch are in arrays, and objects are made of them on access. As in Matterport3DSimulator, a state
changes with its environment: copy the values that you keep. Images are never overwritten.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.simulator.looking import navigable
from nvsim.r2r.simulator.scan import Joined, ways

if TYPE_CHECKING:
    from nvsim.r2r.simulator.scan import Ways

    _Key = tuple[int, int, float | None]  # row, view, smallest cosine

_MOST = 50_000  # largest number of discrete views whose locations are kept


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
    numbers                     (heading, elevation, view, step) of each as numbers of Python, which are read faster
    rgb, depth                  the images of each
    """

    size: int
    rgb: list[NDArray[np.uint8]]
    depth: list[NDArray[np.uint16]]
    joined: Joined | None = None
    scan: list[str] = field(default_factory=list)
    beside: dict[int, Beside] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.scan = [""] * self.size
        self.place = np.zeros(self.size, np.int64)
        self.heading, self.elevation = np.zeros(self.size), np.zeros(self.size)
        self.view, self.step = np.zeros(self.size, np.int64), np.zeros(self.size, np.int64)
        self.numbers = [(0.0, 0.0, 0, 0)] * self.size
        self._known: dict[_Key, list[ViewPoint]] = {}
        self._found: list[list[ViewPoint] | None] = [[]] * self.size

    def look_around(self, discrete: bool, least_cosine: float | None) -> None:
        """Makes `locations` search again: within an angle around the heading, or everywhere if it is None."""
        self._discrete, self._least = discrete, least_cosine
        self.numbers = list(zip(*(a.tolist() for a in (self.heading, self.elevation, self.view, self.step))))
        self._found = [None] * self.size

    def forget(self) -> None:
        """Removes the locations of discrete views, because the rows of `joined` change."""
        self._known = {}

    def locations(self, b: int) -> list[ViewPoint]:
        """Returns the navigable locations of an environment, the current one first. They are searched on first use."""
        found = self._found[b]
        if found is None:
            self._search(b)
            found = self._found[b]
            assert found is not None
        return found

    def _search(self, b: int) -> None:
        joined, places, views = self.joined, self.place.tolist(), self.view.tolist()
        assert joined is not None
        if b in self.beside:
            beside = self.beside[b]
            first = ViewPoint("", -1, beside.position.tolist())
            self._found[b] = self._located([b], np.zeros(1, np.int64), beside.ways, [first])[0]
            return
        missing = []
        for i in range(self.size):
            if self._found[i] is None and i not in self.beside:
                if self._discrete:
                    self._found[i] = self._known.get((places[i], views[i], self._least))
                if self._found[i] is None:
                    missing.append(i)
        if not missing:
            return
        firsts = [_viewpoint(joined, places[i], [0.0, 0.0, 0.0]) for i in missing]
        if len(self._known) > _MOST:
            self._known.clear()
        for i, found in zip(missing, self._located(missing, self.place[missing], joined.ways, firsts)):
            self._found[i] = found
            if self._discrete:
                self._known[places[i], views[i], self._least] = found

    def _located(
        self, environments: list[int], place: NDArray[np.int64], ways: Ways, firsts: list[ViewPoint]
    ) -> list[list[ViewPoint]]:
        """Returns `firsts`, each with the locations of its environment, which is in the row `place` (n,) of `ways`."""
        joined = self.joined
        assert joined is not None
        rows, relative, count = navigable(
            place, self.heading[environments], self.elevation[environments], *ways, self._least
        )
        return [
            [first, *(_viewpoint(joined, row, angles) for row, angles in zip(near[:n], each[:n]))]
            for first, near, each, n in zip(firsts, rows.tolist(), relative.tolist(), count.tolist())
        ]


@dataclass(eq=False)
class Beside:
    """A position outside the graph, (3,) float64 meters, world, with its ways.

    The ways are as in a Scan, and the neighbors are rows of the joined scans.
    """

    position: NDArray[np.float64]
    neighbour: NDArray[np.int64]
    towards: NDArray[np.float32]
    reach: NDArray[np.float64]

    @property
    def ways(self) -> Ways:
        """The ways as arrays with one row."""
        return np.array([0, len(self.neighbour)], np.int64), self.neighbour, self.towards, self.reach

    @staticmethod
    def at(position: NDArray[np.float64], rows: list[int], joined: Joined) -> Beside:
        """Returns a position (3,), meters, world, with free ways to the viewpoints of some rows."""
        ends = np.array([joined.positions[row] for row in rows], np.float32).reshape(-1, 3)
        towards, reach = ways(np.tile(position.astype(np.float32), (len(rows), 1)), ends)
        return Beside(position, np.array(rows, np.int64), towards, reach)


class SimState:
    """The state of one environment. All values except the images are read on access."""

    __slots__ = ("_batch", "_index")

    def __init__(self, batch: Batch, index: int) -> None:
        self._batch, self._index = batch, index

    @property
    def scanId(self) -> str:
        return self._batch.scan[self._index]

    @property
    def step(self) -> int:
        """Number of actions since the episode began."""
        return self._batch.numbers[self._index][3]

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
        return self._batch.numbers[self._index][0]

    @property
    def elevation(self) -> float:
        """Radians above the horizon."""
        return self._batch.numbers[self._index][1]

    @property
    def viewIndex(self) -> int:
        """0 to 35 if viewing angles are discrete: from 0 down, from 12 level, from 24 up."""
        return self._batch.numbers[self._index][2]

    @property
    def location(self) -> ViewPoint:
        found = self._batch.locations(self._index)
        return found[0] if found else ViewPoint("", 0, (0.0, 0.0, 0.0))

    @property
    def navigableLocations(self) -> list[ViewPoint]:
        """The locations for `makeAction`: first the current one, then by their angle from the image center."""
        return self._batch.locations(self._index).copy()

    def __repr__(self) -> str:
        return f"SimState({self.scanId!r}, {self.location!r}, {self.heading:.3f}, {self.elevation:.3f})"


def _viewpoint(joined: Joined, row: int, relative: list[float]) -> ViewPoint:
    return ViewPoint(joined.ids[row], joined.indices[row], joined.positions[row], relative)


def position_of(batch: Batch, b: int) -> NDArray[np.float64]:
    """Returns the position (3,), meters, world, of an environment."""
    assert batch.joined is not None
    return batch.beside[b].position if b in batch.beside else np.array(batch.joined.positions[int(batch.place[b])])


def black(width: int, height: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Returns black images (height, width, 3) uint8 and (height, width, 1) uint16."""
    return np.zeros((height, width, 3), np.uint8), np.zeros((height, width, 1), np.uint16)
