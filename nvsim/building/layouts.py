"""Floor plans: two houses, and a large building with parallel halls and shops.

In the large building, a street is a hall with a row of shops along either side; streets are back to back. The
trajectory goes along one side of a hall, into every shop, and back along the other side, street by street. At the end
it returns through a cross hall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nvsim.building.plan import OUTER_WALL, Opening, Plan, Rect, Room, TrajectoryCorner, Wall

ENTRY = 0.95  # meters inside a door before the trajectory turns


def make_plan(size: str, rng: np.random.Generator, glazed: bool = False, within: Rect | None = None) -> Plan:
    """The plan of a "full" or a "small" building; partitions are of glass if `glazed`. `within` gives a small plan the
    outer walls of another one, meters, and moves its partition."""
    return _full_plan(rng, glazed) if size == "full" else _small_plan(rng, glazed, within)


def _uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A random length on a 5 cm raster, so that the occupancy map of the walls is exact."""
    return float(np.round(rng.uniform(low, high) * 20) / 20)


def outer_walls(width: float, depth: float) -> list[Wall]:
    """The four outer walls of a building of `width` x `depth` meters."""
    return [
        Wall("x", 0.0, 0.0, width, OUTER_WALL),
        Wall("x", depth, 0.0, width, OUTER_WALL),
        Wall("y", 0.0, 0.0, depth, OUTER_WALL),
        Wall("y", width, 0.0, depth, OUTER_WALL),
    ]


def _small_plan(rng: np.random.Generator, glazed: bool, within: Rect | None) -> Plan:
    width, depth = _uniform(rng, 8.8, 9.4), _uniform(rng, 4.8, 5.2)
    split = _uniform(rng, 4.4, 4.8)
    if within is not None:
        width, depth, split = within.x1, within.y1, round(split - 1.0, 2)
    glass_from = _uniform(rng, 3.2, 3.5)
    door = Opening("y", split, _uniform(rng, 1.6, 1.9), _uniform(rng, 0.95, 1.05))
    walls = [
        *outer_walls(width, depth),
        Wall("y", split, 0.0, glass_from, glass=glazed),
        Wall("y", split, glass_from, depth, glass=True),
    ]
    floors = rng.permutation(["tiles", "wood"])
    rooms = (
        Room("west", "lounge", str(floors[0]), (Rect(0, 0, split, depth),)),
        Room("east", "office", str(floors[1]), (Rect(split, 0, width, depth),)),
    )
    west, east = (split * 0.42, depth * 0.55), (split + (width - split) * 0.58, depth * 0.55)
    stops = (
        TrajectoryCorner(split * 0.36, 1.35),
        TrajectoryCorner(*west, turns_in_place=True),
        TrajectoryCorner(split - ENTRY, door.center),
        TrajectoryCorner(split + ENTRY, door.center),
        TrajectoryCorner(*east, turns_in_place=True),
        TrajectoryCorner(split + ENTRY, door.center),
        TrajectoryCorner(split - ENTRY, door.center),
        TrajectoryCorner(split * 0.30, door.center + 0.2),
    )
    return Plan(Rect(0, 0, width, depth), rooms, tuple(walls), (door,), stops)


def _full_plan(rng: np.random.Generator, glazed: bool) -> Plan:
    """Columns of two rooms left and right, one room below and one above, and a ring of corridors about a glazed
    core."""
    left, right = _uniform(rng, 5.2, 5.7), _uniform(rng, 5.2, 5.7)
    below, above = _uniform(rng, 5.0, 5.4), _uniform(rng, 5.0, 5.4)
    corridor = _uniform(rng, 1.6, 1.75)
    core_w = _uniform(rng, 3.5, 4.0)
    width = round(left + right + 2 * corridor + core_w, 2)
    depth = round(round(300.0 / width * 20) / 20, 2)
    x1, x2 = left, width - right
    y1, y2 = below, depth - above
    core = Rect(x1 + corridor, y1 + corridor, x2 - corridor, y2 - corridor)
    split_l = _uniform(rng, (y1 + y2) / 2 - 0.5, (y1 + y2) / 2 + 0.5)
    split_r = _uniform(rng, (y1 + y2) / 2 - 0.2, (y1 + y2) / 2 + 0.2)
    xl, xr, yb, yt = x1 + corridor / 2, x2 - corridor / 2, y1 + corridor / 2, y2 - corridor / 2
    walls = [
        *outer_walls(width, depth),
        Wall("y", x1, 0.0, depth),
        Wall("y", x2, 0.0, depth),
        Wall("x", split_l, 0.0, x1, glass=glazed),
        Wall("x", split_r, x2, width, glass=glazed),
        Wall("x", y1, x1, x2),
        Wall("x", y2, x1, x2),
        Wall("y", core.x0, core.y0, core.y1, glass=glazed),
        Wall("y", core.x1, core.y0, core.y1, glass=glazed),
        Wall("x", core.y0, core.x0 - 0.06, core.x1 + 0.06, glass=True),
        Wall("x", core.y1, core.x0 - 0.06, core.x1 + 0.06, glass=glazed),
    ]

    def door(along: str, line: float, center: float) -> Opening:
        return Opening(along, line, center, _uniform(rng, 0.95, 1.1))

    # The doors on the left are at the ends of corridors, those on the right are beside one
    door_l1 = door("y", x1, yb)
    door_l2 = door("y", x1, yt)
    door_r1 = door("y", x2, yb + _uniform(rng, 0.85, 1.1))
    door_r2 = door("y", x2, yt - _uniform(rng, 0.85, 1.1))
    middle = (x1 + x2) / 2
    door_b = door("x", y1, _uniform(rng, middle - 1.5, middle + 1.5))
    opening_t = Opening("x", y2, _uniform(rng, middle - 1.2, middle + 1.2), _uniform(rng, 1.6, 2.0), 2.3, False)
    opening_l = Opening("x", split_l, _uniform(rng, left * 0.4, left * 0.6), _uniform(rng, 1.3, 1.6), 2.3, False)
    opening_r = Opening("x", split_r, width - _uniform(rng, right * 0.4, right * 0.6), _uniform(rng, 1.0, 1.1))
    door_c = door("x", core.y1, _uniform(rng, middle - 0.8, middle + 0.8))
    ring = (
        Rect(x1, y1, x2, core.y0),
        Rect(x1, core.y1, x2, y2),
        Rect(x1, core.y0, core.x0, core.y1),
        Rect(core.x1, core.y0, x2, core.y1),
    )
    kinds = [str(k) for k in rng.permutation(["office", "lounge", "library", "office", "kitchen", "hall"])]
    floors = [str(f) for f in rng.permutation(["tiles", "wood", "wood", "tiles", "wood", "tiles"])]
    places = [
        ("left below", Rect(0, 0, x1, split_l)),
        ("left above", Rect(0, split_l, x1, depth)),
        ("right below", Rect(x2, 0, width, split_r)),
        ("right above", Rect(x2, split_r, width, depth)),
        ("below", Rect(x1, 0, x2, y1)),
        ("above", Rect(x1, y2, x2, depth)),
    ]
    rooms = [Room(name, k, f, (rect,)) for (name, rect), k, f in zip(places, kinds, floors)]
    rooms += [Room("core", "meeting", "wood", (core,)), Room("corridor", "corridor", "tiles", ring)]
    low_l, high_l = (0.5 * left, split_l * 0.4), (0.5 * left, depth - (depth - split_l) * 0.4)
    low_r, high_r = (width - 0.5 * right, split_r * 0.4), (width - 0.5 * right, depth - (depth - split_r) * 0.4)

    def detour_across(o: Opening, line: float, sign: float, reach: float) -> list[TrajectoryCorner]:
        """The stops of a detour into a room and back. It leaves the corridor at y = `line`, meters, through the opening
        `o`, and visits both ends of the room, `reach` meters deep. `sign` is 1 if the room is above the corridor."""
        inside = TrajectoryCorner(o.center, o.line + sign * ENTRY)
        y = o.line + sign * reach * 0.52
        a, b = x1 + (x2 - x1) * 0.28, x1 + (x2 - x1) * 0.72
        far, near = (a, b) if abs(a - o.center) > abs(b - o.center) else (b, a)
        return [
            TrajectoryCorner(o.center, line),
            inside,
            TrajectoryCorner(far, y, True),
            TrajectoryCorner(near, y),
            inside,
            TrajectoryCorner(o.center, line),
        ]

    stops = [
        # once around: up on the left, with the room above and the core on the way, then the room below
        TrajectoryCorner(xl, door_l1.center),
        TrajectoryCorner(xl, yt),
        *detour_across(opening_t, yt, 1.0, above),
        TrajectoryCorner(door_c.center, yt),
        TrajectoryCorner(door_c.center, core.y1 - ENTRY),
        TrajectoryCorner(middle, (core.y0 + core.y1) / 2 - 0.2, True),
        TrajectoryCorner(door_c.center, core.y1 - ENTRY),
        TrajectoryCorner(door_c.center, yt),
        TrajectoryCorner(xr, yt),
        TrajectoryCorner(xr, yb),
        *detour_across(door_b, yb, -1.0, below),
        TrajectoryCorner(xl, yb),
        # through both rooms on the left
        TrajectoryCorner(xl, door_l1.center),
        TrajectoryCorner(x1 - ENTRY, door_l1.center),
        TrajectoryCorner(*low_l, True),
        TrajectoryCorner(opening_l.center, split_l - 0.6),
        TrajectoryCorner(opening_l.center, split_l + 0.6),
        TrajectoryCorner(*high_l, True),
        TrajectoryCorner(x1 - ENTRY, door_l2.center),
        TrajectoryCorner(xl, door_l2.center),
        # and around the other way, through both rooms on the right
        TrajectoryCorner(xl, yb),
        TrajectoryCorner(xr, yb),
        TrajectoryCorner(xr, door_r1.center),
        TrajectoryCorner(x2 + ENTRY, door_r1.center),
        TrajectoryCorner(*low_r, True),
        TrajectoryCorner(opening_r.center, split_r - 0.6),
        TrajectoryCorner(opening_r.center, split_r + 0.6),
        TrajectoryCorner(*high_r, True),
        TrajectoryCorner(x2 + ENTRY, door_r2.center),
        TrajectoryCorner(xr, door_r2.center),
        TrajectoryCorner(xr, yt),
        TrajectoryCorner(xl, yt),
    ]
    openings = (door_l1, door_l2, door_r1, door_r2, door_b, opening_t, opening_l, opening_r, door_c)
    return Plan(Rect(0, 0, width, depth), tuple(rooms), tuple(walls), openings, tuple(stops))


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
class _HallPlan:
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
        _HallPlan(cross, _on_raster(width - cross), *(_on_raster((k + s) * across) for s in (0, 0.5, 1)))
        for k in range(count)
    ]
    rooms, walls, openings = [], outer_walls(width, depth), []
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
    stops = _trajectory_through_shops(streets, shops, width, rng)
    return Plan(Rect(0, 0, width, depth), tuple(rooms), tuple(walls), tuple(openings), tuple(stops))


def _on_raster(value: float) -> float:
    return round(round(value / _RASTER) * _RASTER, 2)


def _hall(name: str, rect: Rect) -> Room:
    return Room(name, "corridor", "tiles", (rect,))


@dataclass(frozen=True)
class _ShopRow:
    """The shops along one side of a hall; `visits` has the opening and the ground of each shop."""

    rooms: list[Room]
    walls: list[Wall]
    openings: list[Opening]
    visits: list[tuple[Opening, Rect]]


def _row(street: _HallPlan, front: float, back: float, name: str, rng: np.random.Generator, glazed: bool) -> _ShopRow:
    length = street.end - street.start
    count = max(2, round(length / float(np.mean(_WIDTH))))
    parts = np.cumsum(rng.uniform(*_WIDTH, count))
    edges = [street.start, *(_on_raster(street.start + length * p / parts[-1]) for p in parts[:-1]), street.end]
    row = _ShopRow([], [], [], [])
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


def _columns(street: _HallPlan) -> list[Wall]:
    """Columns along the middle of a hall, away from both ends."""
    room = street.end - street.start - 6.0
    count = int(room // _BETWEEN_COLUMNS)
    places = street.start + 3.0 + room * (np.arange(count) + 0.5) / max(count, 1)
    half = _COLUMN / 2
    return [Wall("x", street.middle, _on_raster(x - half), _on_raster(x + half), _COLUMN) for x in places]


def _trajectory_through_shops(
    streets: list[_HallPlan], shops: list[list[tuple[Opening, Rect]]], width: float, rng: np.random.Generator
) -> list[TrajectoryCorner]:
    """East along the lower shops of a street, west along its upper ones, then the next street; back through the
    east."""
    cross = streets[0].start
    west, east = (cross / 2, width - cross / 2) if cross else (1.2, width - 1.2)
    stops: list[TrajectoryCorner] = []
    for k, street in enumerate(streets):
        low, high = _on_raster(street.middle - _LANE), _on_raster(street.middle + _LANE)
        stops.append(TrajectoryCorner(west, low))
        for opening, rect in sorted(shops[2 * k], key=lambda visit: visit[0].center):
            stops += _visit(opening, rect, low, -1.0, rng)
        stops += [TrajectoryCorner(east, low), TrajectoryCorner(east, high)]
        for opening, rect in sorted(shops[2 * k + 1], key=lambda visit: -visit[0].center):
            stops += _visit(opening, rect, high, 1.0, rng)
        stops.append(TrajectoryCorner(west, high))
    if cross:
        last, first = streets[-1], streets[0]
        stops += [
            TrajectoryCorner(west, last.middle + 0.5),
            TrajectoryCorner(east, last.middle + 0.5),
            TrajectoryCorner(east, first.middle),
        ]
    return stops


def _visit(opening: Opening, rect: Rect, lane: float, sign: float, rng: np.random.Generator) -> list[TrajectoryCorner]:
    """From the lane at y = `lane` through the opening to the middle of the shop, a full turn there, and back."""
    inside = TrajectoryCorner(opening.center, opening.line + sign * ENTRY)
    x, y = rect.center
    middle = TrajectoryCorner(
        _on_raster(x + rng.uniform(-0.4, 0.4)), _on_raster(y + sign * rng.uniform(0.0, 0.6)), True
    )
    return [TrajectoryCorner(opening.center, lane), inside, middle, inside, TrajectoryCorner(opening.center, lane)]
