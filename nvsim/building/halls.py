"""The floor plan of a large building: parallel halls with shops on both sides, joined by cross halls at their ends.

A street is a hall with a row of shops along either side; streets are back to back. The trajectory goes along one side
of a hall, into every shop, and back along the other side, street by street. At the end it returns through a cross hall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nvsim.building.layouts import ENTRY, outer
from nvsim.building.plan import Opening, Plan, Rect, Room, Stop, Wall

_HALL = 6.0  # meters across a hall
_CROSS = 5.0  # meters across a cross hall
_STREET = 23.0  # meters across a hall and its two rows, approximately
_WIDTH = (6.0, 10.5)  # meters of a shop along its hall
_LANE = 1.5  # meters between the middle of a hall and the trajectory
_COLUMN = 0.5  # meters: side of a column
_BETWEEN_COLUMNS = 9.0  # meters
_KINDS = ("lounge", "library", "office", "kitchen", "hall", "lounge", "library")
_RASTER = 0.05  # meters: raster of the plan, equal to that of the true occupancy map


@dataclass(frozen=True)
class _Street:
    """One hall from x = `start` to `end`, its middle at y = `middle`; the backs of its rows are at `low` and `high`."""

    start: float
    end: float
    low: float
    middle: float
    high: float

    @property
    def fronts(self) -> tuple[float, float]:
        return _on_raster(self.middle - _HALL / 2), _on_raster(self.middle + _HALL / 2)


def make_halls(area: float, rng: np.random.Generator, glazed: bool = False) -> Plan:
    """The plan of a building of about `area` square meters; walls between shops are of glass if `glazed`."""
    count = max(1, round(np.sqrt(area) / (_STREET + 3)))
    across = _on_raster(_STREET + rng.uniform(-0.6, 0.6)) if area > 600 else 18.0
    depth = _on_raster(count * across)
    width = _on_raster(area / depth)
    cross = _CROSS if count > 1 else 0.0
    streets = [
        _Street(cross, _on_raster(width - cross), *(_on_raster((k + s) * across) for s in (0, 0.5, 1)))
        for k in range(count)
    ]
    rooms, walls, openings = [], outer(width, depth), []
    shops: list[list[tuple[Opening, Rect]]] = []
    for k, street in enumerate(streets):
        for row, (front, back) in enumerate(zip(street.fronts, (street.low, street.high))):
            made = _row(street, front, back, f"{k + 1}{'ab'[row]}", rng, glazed)
            rooms += made.rooms
            walls += made.walls
            openings += made.openings
            shops.append(made.visits)
        if k:
            walls.append(Wall("x", street.low, street.start, street.end))
        walls += _columns(street)
        rooms.append(_hall(f"hall {k + 1}", Rect(street.start, street.fronts[0], street.end, street.fronts[1])))
    if cross:
        for name, x0, x1 in (("cross west", 0.0, cross), ("cross east", _on_raster(width - cross), width)):
            rooms.append(_hall(name, Rect(x0, 0.0, x1, depth)))
    stops = _tour(streets, shops, width, rng)
    return Plan(Rect(0, 0, width, depth), tuple(rooms), tuple(walls), tuple(openings), tuple(stops))


def _on_raster(value: float) -> float:
    return round(round(value / _RASTER) * _RASTER, 2)


def _hall(name: str, rect: Rect) -> Room:
    return Room(name, "corridor", "tiles", (rect,))


@dataclass(frozen=True)
class _Row:
    """The shops along one side of a hall; `visits` has the opening and the ground of each shop."""

    rooms: list[Room]
    walls: list[Wall]
    openings: list[Opening]
    visits: list[tuple[Opening, Rect]]


def _row(street: _Street, front: float, back: float, name: str, rng: np.random.Generator, glazed: bool) -> _Row:
    length = street.end - street.start
    count = max(2, round(length / float(np.mean(_WIDTH))))
    parts = np.cumsum(rng.uniform(*_WIDTH, count))
    edges = [street.start, *(_on_raster(street.start + length * p / parts[-1]) for p in parts[:-1]), street.end]
    row = _Row([], [], [], [])
    if street.start > 0:
        low, high = min(front, back), max(front, back)
        row.walls.extend([Wall("y", street.start, low, high), Wall("y", street.end, low, high)])
    for i, (x0, x1) in enumerate(zip(edges, edges[1:])):
        rect = Rect(x0, min(front, back), x1, max(front, back))
        floor = str(rng.choice(["tiles", "wood", "wood"]))
        row.rooms.append(Room(f"shop {name}{i + 1}", str(rng.choice(_KINDS)), floor, (rect,)))
        middle = _on_raster(rng.uniform(x0 + 0.4 * (x1 - x0), x1 - 0.4 * (x1 - x0)))
        style = str(rng.choice(["open", "window", "door"], p=[0.4, 0.35, 0.25]))
        if style == "open":
            opening = Opening("x", front, middle, _on_raster(rng.uniform(2.2, 3.0)), 2.3, False)
        else:
            opening = Opening("x", front, middle, _on_raster(rng.uniform(1.0, 1.3)))
        row.walls.append(Wall("x", front, x0, x1, glass=style == "window"))
        row.openings.append(opening)
        row.visits.append((opening, rect))
        if i:
            row.walls.append(Wall("y", x0, rect.y0, rect.y1, glass=glazed))
    return row


def _columns(street: _Street) -> list[Wall]:
    """Columns along the middle of a hall, away from both ends."""
    room = street.end - street.start - 6.0
    count = int(room // _BETWEEN_COLUMNS)
    places = street.start + 3.0 + room * (np.arange(count) + 0.5) / max(count, 1)
    half = _COLUMN / 2
    return [Wall("x", street.middle, _on_raster(x - half), _on_raster(x + half), _COLUMN) for x in places]


def _tour(
    streets: list[_Street], shops: list[list[tuple[Opening, Rect]]], width: float, rng: np.random.Generator
) -> list[Stop]:
    """East along the lower shops of a street, west along its upper ones, then the next street; back through the
    east."""
    cross = streets[0].start
    west, east = (cross / 2, width - cross / 2) if cross else (1.2, width - 1.2)
    stops: list[Stop] = []
    for k, street in enumerate(streets):
        low, high = _on_raster(street.middle - _LANE), _on_raster(street.middle + _LANE)
        stops.append(Stop(west, low))
        for opening, rect in sorted(shops[2 * k], key=lambda visit: visit[0].centre):
            stops += _visit(opening, rect, low, -1.0, rng)
        stops += [Stop(east, low), Stop(east, high)]
        for opening, rect in sorted(shops[2 * k + 1], key=lambda visit: -visit[0].centre):
            stops += _visit(opening, rect, high, 1.0, rng)
        stops.append(Stop(west, high))
    if cross:
        last, first = streets[-1], streets[0]
        stops += [Stop(west, last.middle + 0.5), Stop(east, last.middle + 0.5), Stop(east, first.middle)]
    return stops


def _visit(opening: Opening, rect: Rect, lane: float, sign: float, rng: np.random.Generator) -> list[Stop]:
    """From the lane at y = `lane` through the opening to the middle of the shop, a full turn there, and back."""
    inside = Stop(opening.centre, opening.line + sign * ENTRY)
    x, y = rect.centre
    middle = Stop(_on_raster(x + rng.uniform(-0.4, 0.4)), _on_raster(y + sign * rng.uniform(0.0, 0.6)), True)
    return [Stop(opening.centre, lane), inside, middle, inside, Stop(opening.centre, lane)]
