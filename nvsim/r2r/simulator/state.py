"""The state of each environment of a batch, and the locations that it can move to.

Source: the behavior of Matterport3DSimulator, with which the tests compare. It sorts lists of more than 16 locations
with an unstable sort, so the order of locations with exactly equal angles may differ. Here it is the order in the
file.

Navigable locations are searched on first access, and kept for discrete views. As in Matterport3DSimulator, a state
changes with its environment: copy the values that you keep. Images are never overwritten.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.directions import HEADINGS, STEP, VIEWS
from nvsim.r2r.simulator.scan import JoinedScans, directions_and_distances

if TYPE_CHECKING:
    from nvsim.r2r.simulator.scan import Ways

TURN = 2 * math.pi


def rounded_view_direction(
    headings: list[float], elevations: list[float], discrete: bool, lowest: float, highest: float, views: list[int]
) -> tuple[list[float], list[float], list[int]]:
    """Rounds headings and elevations, radians, to the discrete views, or limits elevations to `lowest` and `highest`.

    Returns headings in [0, 2 pi), elevations, and views: 0 to 35 if `discrete` is true, else `views`.
    """
    headings = [h % TURN for h in headings]
    if not discrete:
        return headings, [max(min(e, highest), lowest) for e in elevations], views
    steps = [int(h / (TURN / HEADINGS) + 0.5) % HEADINGS for h in headings]
    rows = [0 if e < -STEP / 2 else 2 if e > STEP / 2 else 1 for e in elevations]
    views = [step + HEADINGS * row for step, row in zip(steps, rows)]
    return [step * (TURN / HEADINGS) for step in steps], [(row - 1) * STEP for row in rows], views


def navigable(
    place: NDArray[np.int64],  # (B,) rows of `starts`
    heading: NDArray[np.float64],  # (B,) radians
    elevation: NDArray[np.float64],  # (B,) radians
    starts: NDArray[np.int64],  # the arrays of a Scan, or of several joined scans
    neighbor: NDArray[np.int64],
    towards: NDArray[np.float32],
    reach: NDArray[np.float64],
    least_cosine: float | None,  # cosine of the largest angle between a location and the heading; None for any angle
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Finds the navigable locations of the environments (B,), without the current ones.

    Returns rows (B, K) sorted by the angle from the image center, their heading, elevation, and distance (B, K, 3), and
    the number of valid columns (B,).
    """
    first, end = starts[place], starts[place + 1]
    column = np.arange((end - first).max(initial=0))
    exists = column < (end - first)[:, None]
    way = np.where(exists, first[:, None] + column, 0)
    flat = towards[way]
    x, y, east, north = flat[..., 0], flat[..., 1], flat[..., 2], flat[..., 3]
    angle = (math.pi / 2 - heading)[:, None]
    cx, cy = np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)
    if least_cosine is not None:
        exists = exists & ((east * cx + north * cy).astype(np.float64) >= least_cosine)
    relative = np.empty((*way.shape, 3))
    relative[..., 2], up = reach[way, 0], reach[way, 1]
    relative[..., 0] = h = np.arctan2(x * cy - y * cx, x * cx + y * cy).astype(np.float64)
    relative[..., 1] = e = up - elevation[:, None]
    order = np.argsort(np.where(exists, np.sqrt(h * h + e * e), np.inf), axis=1, kind="stable")
    each = np.arange(len(place))[:, None]
    return neighbor[way[each, order]], relative[each, order], exists.sum(axis=1)


_MOST = 50_000  # largest number of discrete views whose locations are kept
_AFTER = [
    [
        (view + sideways) % HEADINGS + HEADINGS * max(0, min(2, view // HEADINGS + up))
        for up in (0, 1, -1)
        for sideways in (0, 1, -1)
    ]
    for view in range(VIEWS)
]
"""The views after a turn, for each view: 3 * (1 up, 2 down) + (1 right, 2 left)."""
_NUMBERS = frozenset((float, int))
_INFINITE = math.inf
_HEADING = [view % HEADINGS * (TURN / HEADINGS) for view in range(VIEWS)]
_ELEVATION = [(view // HEADINGS - 1) * STEP for view in range(VIEWS)]


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
    """The state of the B environments of a batch. Each list has one value for each environment.

    size                        B
    rgb, depth                  the images
    joined                      the scans of the environments, None before the first episode
    scan                        scan ids
    beside                      environment -> its position outside the graph, with its ways to viewpoints
    place                       rows of `joined`
    heading, elevation          radians
    view                        0 to 35 if views are discrete
    step                        actions since the episode began
    found                       locations, None if they are not searched yet
    quick_angle                 vertical field of view times width / height, radians, for which `act` may be used, else
                                None
    """

    size: int
    rgb: list[NDArray[np.uint8]]
    depth: list[NDArray[np.uint16]]
    joined: JoinedScans | None = None
    scan: list[str] = field(default_factory=list)
    beside: dict[int, OffGraphPosition] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.scan, self._each = [""] * self.size, range(self.size)
        self.place, self.view, self.step = [0] * self.size, [0] * self.size, [0] * self.size
        self.heading, self.elevation = [0.0] * self.size, [0.0] * self.size
        self.quick_angle: float | None = None
        self._discrete = False
        self._least: float | None = None
        self._searched = self.joined
        self._known: dict[int, list[ViewPoint]] = {}  # 36 * row + view -> locations, if views are discrete
        self.found: list[list[ViewPoint] | None] = [[]] * self.size

    def look_around(self, discrete: bool, least_cosine: float | None) -> None:
        """Makes `locations` search again: within an angle around the heading, or everywhere if it is None."""
        if self._searched is not self.joined or self._least != least_cosine or len(self._known) > _MOST:
            self._known = {}
        self._discrete, self._least, self._searched = discrete, least_cosine, self.joined
        self.found = [None] * self.size

    def act(self, index: Any, heading: Any, elevation: Any, angle: float) -> bool:
        """Moves and turns the environments as `Simulator.makeAction` does, in the usual case: the arguments are lists
        of valid numbers, views are discrete, no images are drawn, and no environment is beside the graph.

        Returns False in other cases, and changes nothing then.
        """
        size, joined, found = self.size, self.joined, self.found
        if angle != self.quick_angle or self.beside or joined is None or len(self._known) > _MOST:
            return False
        if type(index) is not list or type(heading) is not list or type(elevation) is not list:
            return False
        if len(index) < size or len(heading) < size or len(elevation) < size:
            return False
        place, view, after = self.place, self.view, []
        for b in self._each:
            way, h, e = index[b], heading[b], elevation[b]
            if type(way) is not int or way < 0 or type(h) not in _NUMBERS or type(e) not in _NUMBERS:
                return False
            turn = 0 if h == 0 else 1 if 0 < h < _INFINITE else 2 if 0 > h > -_INFINITE else -9
            turn += 0 if e == 0 else 3 if 0 < e < _INFINITE else 6 if 0 > e > -_INFINITE else -9
            if turn < 0:
                return False
            row = place[b]
            if way:
                locations = found[b]
                if locations is None:
                    locations = self.locations(b)
                if way >= len(locations):
                    return False
                row = joined.first[self.scan[b]] + locations[way].ix
            new = _AFTER[view[b]][turn]
            after.append((row, new, _HEADING[new], _ELEVATION[new]))
        known, step, headings, elevations = self._known, self.step, self.heading, self.elevation
        for b, (row, new, h, e) in zip(self._each, after):
            place[b], view[b], headings[b], elevations[b] = row, new, h, e
            step[b] += 1
            found[b] = known.get(VIEWS * row + new)
        return True

    def locations(self, b: int) -> list[ViewPoint]:
        """Returns the navigable locations of an environment, the current one first. They are searched on first use."""
        found = self.found[b]
        if found is None and self._discrete and b not in self.beside:
            found = self._known.get(VIEWS * self.place[b] + self.view[b])
        if found is None:
            found = self._search(b)
        self.found[b] = found
        return found

    def _search(self, b: int) -> list[ViewPoint]:
        """Searches the locations of an environment, and those of all others that are not known, which is faster."""
        assert self.joined is not None
        if b in self.beside:
            beside = self.beside[b]
            return self._add_locations([b], [0], beside.ways, [ViewPoint("", -1, beside.position.tolist())])[0]
        missing = [i for i in range(self.size) if self.found[i] is None and i not in self.beside]
        if self._discrete:
            missing = [i for i in missing if VIEWS * self.place[i] + self.view[i] not in self._known]
        places = [self.place[i] for i in missing]
        firsts = [_viewpoint(self.joined, place, [0.0, 0.0, 0.0]) for place in places]
        each = dict(zip(missing, self._add_locations(missing, places, self.joined.ways, firsts)))
        for i, found in each.items():
            self.found[i] = found
            if self._discrete:
                self._known[VIEWS * self.place[i] + self.view[i]] = found
        return each[b]

    def _add_locations(
        self, environments: list[int], places: list[int], ways: Ways, firsts: list[ViewPoint]
    ) -> list[list[ViewPoint]]:
        """Returns `firsts`, each with the locations of its environment, which is in the row `places` of `ways`."""
        joined = self.joined
        assert joined is not None
        headings, elevations = (np.array([a[b] for b in environments]) for a in (self.heading, self.elevation))
        rows, relative, count = navigable(np.array(places), headings, elevations, *ways, self._least)
        return [
            [first, *(_viewpoint(joined, row, angles) for row, angles in zip(near[:n], each[:n]))]
            for first, near, each, n in zip(firsts, rows.tolist(), relative.tolist(), count.tolist())
        ]


@dataclass(eq=False)
class OffGraphPosition:
    """A position outside the graph, (3,) float64 meters, world, with its ways.

    The ways are as in a Scan, and the neighbors are rows of the joined scans.
    """

    position: NDArray[np.float64]
    neighbor: NDArray[np.int64]
    towards: NDArray[np.float32]
    reach: NDArray[np.float64]

    @property
    def ways(self) -> Ways:
        """The ways as arrays with one row."""
        return np.array([0, len(self.neighbor)], np.int64), self.neighbor, self.towards, self.reach

    @staticmethod
    def with_free_ways(position: NDArray[np.float64], rows: list[int], joined: JoinedScans) -> OffGraphPosition:
        """Returns a position (3,), meters, world, with free ways to the viewpoints of some rows."""
        ends = np.array([joined.positions[row] for row in rows], np.float32).reshape(-1, 3)
        towards, reach = directions_and_distances(np.tile(position.astype(np.float32), (len(rows), 1)), ends)
        return OffGraphPosition(position, np.array(rows, np.int64), towards, reach)


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
        return self._batch.step[self._index]

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
        return self._batch.heading[self._index]

    @property
    def elevation(self) -> float:
        """Radians above the horizon."""
        return self._batch.elevation[self._index]

    @property
    def viewIndex(self) -> int:
        """0 to 35 if viewing angles are discrete: from 0 down, from 12 level, from 24 up."""
        return self._batch.view[self._index]

    @property
    def location(self) -> ViewPoint:
        found = self._batch.locations(self._index)
        return found[0] if found else ViewPoint("", 0, (0.0, 0.0, 0.0))

    @property
    def navigableLocations(self) -> list[ViewPoint]:
        """The locations for `makeAction`: first the current one, then by their angle from the image center."""
        found = self._batch.found[self._index]
        return (self._batch.locations(self._index) if found is None else found).copy()

    def __repr__(self) -> str:
        return f"SimState({self.scanId!r}, {self.location!r}, {self.heading:.3f}, {self.elevation:.3f})"


def _viewpoint(joined: JoinedScans, row: int, relative: list[float]) -> ViewPoint:
    return ViewPoint(joined.ids[row], joined.indices[row], joined.positions[row], relative)


def position_of(batch: Batch, b: int) -> NDArray[np.float64]:
    """Returns the position (3,), meters, world, of an environment."""
    assert batch.joined is not None
    return batch.beside[b].position if b in batch.beside else np.array(batch.joined.positions[batch.place[b]])


def black_images(width: int, height: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Returns black images (height, width, 3) uint8 and (height, width, 1) uint16."""
    return np.zeros((height, width, 3), np.uint8), np.zeros((height, width, 1), np.uint16)
