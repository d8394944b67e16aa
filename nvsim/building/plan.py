"""The floor plan as data: rooms, walls with openings, the stops of the trajectory, and a straight flight of stairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

GOING = 0.28  # meters from riser to riser
RISERS = 18  # of 0.167 m each, between floors that are 3 m apart
LENGTH = (RISERS - 1) * GOING  # meters from the first riser to the last, which ends on the upper floor


@dataclass(frozen=True)
class Flight:
    """foot, head  (x, y) meters of the middle of the first and of the last riser, on a line along x or y
    width       meters between the walls
    """

    foot: tuple[float, float]
    head: tuple[float, float]
    width: float

    @property
    def climb(self) -> float:
        """Meters from the lower floor to the upper one."""
        return HEIGHT + SLAB

    @property
    def rise(self) -> float:
        """Height of one step, meters."""
        return self.climb / RISERS

    @property
    def rect(self) -> Rect:
        """The ground under the treads, which is also the opening in the floor above, meters."""
        return self._ground_between(0, RISERS - 1)

    def treads(self) -> list[tuple[Rect, float]]:
        """The ground of each tread and its height above the lower floor, meters, from the lowest tread on."""
        return [(self._ground_between(i, i + 1), (i + 1) * self.rise) for i in range(RISERS - 1)]

    @property
    def direction(self) -> NDArray[np.float64]:
        """(2,) the unit vector from foot to head."""
        ahead = np.array(self.head) - np.array(self.foot)
        return np.asarray(ahead / np.linalg.norm(ahead))

    def distance_along(self, xy: NDArray[np.floating]) -> NDArray[np.float64]:
        """(...) distances of places (..., 2) from the first riser toward the last one, meters."""
        return np.asarray((np.asarray(xy, np.float64) - self.foot) @ self.direction)

    def height_at(self, xy: NDArray[np.floating]) -> NDArray[np.float64]:
        """(...) meters above the lower floor at places (..., 2) on the stairs or near their ends. This is the line
        through the middles of the treads, from half a tread before the first riser to half a tread behind the last. The
        surface of a tread is within half a rise of it."""
        return np.asarray(np.clip(self.rise * (self.distance_along(xy) / GOING + 0.5), 0.0, self.climb))

    def mapped(self, point: Callable[[float, float], tuple[float, float]]) -> Flight:
        """The mirror image or quarter turn by `point`."""
        return replace(self, foot=point(*self.foot), head=point(*self.head))

    def _ground_between(self, first: int, last: int) -> Rect:
        """The ground between two risers, rounded to a micrometer, so that neighbors have exactly equal edges."""
        (x0, y0), (x1, y1) = self._riser_position(first), self._riser_position(last)
        low, high = (min(x0, x1), min(y0, y1)), (max(x0, x1), max(y0, y1))
        sides = (0.0, self.width / 2) if abs(x1 - x0) > abs(y1 - y0) else (self.width / 2, 0.0)
        edges = low[0] - sides[0], low[1] - sides[1], high[0] + sides[0], high[1] + sides[1]
        return Rect(*(round(e, 6) for e in edges))

    def _riser_position(self, riser: int) -> tuple[float, float]:
        share = riser / (RISERS - 1)
        (x0, y0), (x1, y1) = self.foot, self.head
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0)


HEIGHT = 2.7  # meters from floor to ceiling
SLAB = 0.3  # meters between a ceiling and the floor above it
INNER_WALL, OUTER_WALL, GLASS = 0.12, 0.2, 0.02  # thicknesses, meters


@dataclass(frozen=True)
class Rect:
    """An axis-aligned rectangle on the ground, meters."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def center(self) -> tuple[float, float]:
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2

    @property
    def area(self) -> float:
        return (self.x1 - self.x0) * (self.y1 - self.y0)

    @property
    def corners(self) -> tuple[float, float, float, float]:
        return self.x0, self.y0, self.x1, self.y1

    def contains(self, x: float, y: float) -> bool:
        return self.x0 <= x < self.x1 and self.y0 <= y < self.y1

    def expanded(self, margin: float) -> Rect:
        return Rect(self.x0 - margin, self.y0 - margin, self.x1 + margin, self.y1 + margin)

    def overlaps(self, other: Rect) -> bool:
        return self.x0 < other.x1 and other.x0 < self.x1 and self.y0 < other.y1 and other.y0 < self.y1


@dataclass(frozen=True)
class Room:
    """A room. `rects` extend to the center lines of the walls; a ring of corridors has four."""

    name: str
    kind: str
    floor: str
    rects: tuple[Rect, ...]

    def contains(self, x: float, y: float) -> bool:
        return any(r.contains(x, y) for r in self.rects)


@dataclass(frozen=True)
class Wall:
    """A wall from floor to ceiling on the line x = `line` (along y) or y = `line` (along x); meters."""

    along: str  # "x" or "y"
    line: float
    start: float
    end: float
    thickness: float = INNER_WALL
    glass: bool = False


@dataclass(frozen=True)
class Opening:
    """A doorway in the wall on `line`, with a clear width and height in meters; `framed` if it is a door."""

    along: str
    line: float
    center: float
    width: float
    height: float = 2.08
    framed: bool = True

    def rect(self, depth: float) -> Rect:
        """The ground within `depth` meters of the opening on both sides."""
        half = self.width / 2
        if self.along == "x":
            return Rect(self.center - half, self.line - depth, self.center + half, self.line + depth)
        return Rect(self.line - depth, self.center - half, self.line + depth, self.center + half)


@dataclass(frozen=True)
class TrajectoryCorner:
    """A corner of the trajectory, meters; with `turns_in_place`, the camera turns there, the long way round."""

    x: float
    y: float
    turns_in_place: bool = False


@dataclass(frozen=True)
class Plan:
    """The floor plan of a storey, in meters; the lower corner of `extent` is the origin. `flight` is the flight of
    stairs to the storey above or below."""

    extent: Rect
    rooms: tuple[Room, ...]
    walls: tuple[Wall, ...]
    openings: tuple[Opening, ...]
    trajectory_corners: tuple[TrajectoryCorner, ...]
    flight: Flight | None = None

    def room_at(self, x: float, y: float) -> Room | None:
        return next((r for r in self.rooms if r.contains(x, y)), None)

    def flipped_x(self) -> Plan:
        """The mirror image across the vertical center line."""
        width = self.extent.x1
        return self._map_plan(
            lambda r: Rect(width - r.x1, r.y0, width - r.x0, r.y1),
            lambda x, y: (width - x, y),
            lambda w: (
                replace(w, start=width - w.end, end=width - w.start)
                if w.along == "x"
                else replace(w, line=width - w.line)
            ),
            lambda o: replace(o, center=width - o.center) if o.along == "x" else replace(o, line=width - o.line),
        )

    def transposed(self) -> Plan:
        """The plan with x and y exchanged."""
        other = {"x": "y", "y": "x"}
        return self._map_plan(
            lambda r: Rect(r.y0, r.x0, r.y1, r.x1),
            lambda x, y: (y, x),
            lambda w: replace(w, along=other[w.along]),
            lambda o: replace(o, along=other[o.along]),
        )

    def _map_plan(
        self,
        rect: Callable[[Rect], Rect],
        point: Callable[[float, float], tuple[float, float]],
        wall: Callable[[Wall], Wall],
        opening: Callable[[Opening], Opening],
    ) -> Plan:
        return Plan(
            rect(self.extent),
            tuple(replace(r, rects=tuple(rect(q) for q in r.rects)) for r in self.rooms),
            tuple(wall(w) for w in self.walls),
            tuple(opening(o) for o in self.openings),
            tuple(TrajectoryCorner(*point(s.x, s.y), s.turns_in_place) for s in self.trajectory_corners),
            None if self.flight is None else self.flight.mapped(point),
        )


@dataclass(frozen=True)
class Storey:
    """A plan and the height of its floor, meters."""

    plan: Plan
    floor: float


def turn_randomly(plans: tuple[Plan, ...], rng: np.random.Generator) -> tuple[Plan, ...]:
    """The plans in one of the eight mirror images and quarter turns, an equal one for all plans."""
    flips = rng.integers(0, 2, 3)
    if flips[0]:
        plans = tuple(p.flipped_x() for p in plans)
    if flips[1]:
        plans = tuple(p.transposed().flipped_x() for p in plans)
    if flips[2]:
        plans = tuple(p.transposed() for p in plans)
    return plans
