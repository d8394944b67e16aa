"""The storeys of a building: one plan, or two stacked plans with stairs in a strip along one side of both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nvsim.building.config import BuildingConfig
from nvsim.building.layouts import ENTRY, make_halls, make_plan, outer_walls
from nvsim.building.plan import (
    HEIGHT,
    INNER_WALL,
    LENGTH,
    OUTER_WALL,
    SLAB,
    Flight,
    Opening,
    Plan,
    Rect,
    Room,
    Storey,
    TrajectoryCorner,
    Wall,
    turn_randomly,
)

_STRIP = 1.4  # meters from the middle of its inner wall to that of the outer one
_LANDING = 1.1  # meters from the end of the flight to the middle of the door
_SHORT = 0.8  # meters from the foot of the flight to the middle of the door
_BEFORE = 1.75  # meters from the foot to the wall before it


def make_storeys(config: BuildingConfig, rng: np.random.Generator, upper: np.random.Generator) -> tuple[Storey, ...]:
    """The storeys, the lowest first; `rng` decides the lowest one and the outer walls, `upper` the storey above it."""
    glazed = config.style == "glass"
    if config.size == "halls":
        return (Storey(turn_randomly((make_halls(config.area, rng, glazed),), rng)[0], 0.0),)
    if config.storeys == 1:
        return (Storey(turn_randomly((make_plan(config.size, rng, glazed),), rng)[0], 0.0),)
    below = make_plan(config.size, rng, glazed)
    above = (
        _shuffle_room_kinds(below, upper) if config.size == "full" else make_plan("small", upper, glazed, below.extent)
    )
    return tuple(
        Storey(plan, k * (HEIGHT + SLAB))
        for k, plan in enumerate(turn_randomly(_join_with_strip(config.size, below, above), rng))
    )


def _shuffle_room_kinds(plan: Plan, rng: np.random.Generator) -> Plan:
    """The plan with the kinds and floors of its rooms shuffled; walls stay."""
    rooms = [r for r in plan.rooms if r.kind not in ("corridor", "meeting")]
    kinds, floors = rng.permutation([r.kind for r in rooms]), rng.permutation([r.floor for r in rooms])
    changed = [replace(r, kind=str(k), floor=str(f)) for r, k, f in zip(rooms, kinds, floors)]
    return replace(plan, rooms=(*changed, *plan.rooms[len(rooms) :]))


def _join_with_strip(size: str, below: Plan, above: Plan) -> tuple[Plan, Plan]:
    """Both plans with the strip beyond their far side. The upper plan is mirrored in x, so that its tour begins and
    ends on the side where the stairs arrive."""
    width, depth = below.extent.x1, below.extent.y1
    middle = depth + (_STRIP + INNER_WALL / 2 - OUTER_WALL / 2) / 2
    foot = _BEFORE if size == "small" else round(width - below.walls[4].line / 2 - _LANDING - LENGTH, 2)
    head = round(foot + LENGTH, 6)
    flight = Flight((foot, middle), (head, middle), round(_STRIP - INNER_WALL / 2 - OUTER_WALL / 2, 6))
    ways = ((), ()) if size == "small" else (_to_the_far_room(below), _to_the_near_room(above))
    entry, landing = round(foot - _SHORT, 2), round(head + _LANDING, 2)
    low = _with_strip(below, flight, entry, (foot - _BEFORE, foot), (foot - _BEFORE, head + INNER_WALL / 2))
    arrive = (*ways[0], TrajectoryCorner(entry, depth - ENTRY), TrajectoryCorner(entry, middle))
    low = replace(low, trajectory_corners=(*low.trajectory_corners, *arrive))
    far = head + 2 * _LANDING if width - head > 3 * _LANDING else width
    high = _with_strip(above.flipped_x(), flight, landing, (foot, far), (foot - INNER_WALL / 2, far))
    way = [replace(s, x=width - s.x) for s in ways[1]]
    leave = (TrajectoryCorner(landing, middle), TrajectoryCorner(landing, depth - ENTRY), *way[::-1])
    high = replace(
        high, trajectory_corners=(*leave, *high.trajectory_corners, *leave[::-1], TrajectoryCorner(entry, middle))
    )
    return low, high


def _with_strip(
    plan: Plan, flight: Flight, door: float, room: tuple[float, float], closed: tuple[float, float]
) -> Plan:
    """The plan with the strip beyond its far side. The strip has a room from `room[0]` to `room[1]` with a door at
    x = `door`, and walls across it at x = `closed`; meters. If that room does not contain the flight, a second room
    does."""
    width, depth = plan.extent.x1, plan.extent.y1
    beyond = round(depth + _STRIP, 2)
    across = [Wall("y", x, depth, beyond) for x in closed if 0.2 < x < width - 0.2]
    walls = (*outer_walls(width, beyond), Wall("x", depth, 0.0, width), *plan.walls[4:], *across)
    rooms = [*plan.rooms, Room("stairs", "stairs", "tiles", (Rect(room[0], depth, room[1], beyond),))]
    x0, _, x1, _ = flight.rect.corners
    if room[1] <= x0:
        rooms.append(Room("flight", "flight", "tiles", (Rect(x0, depth, x1, beyond),)))
    opening = Opening("x", depth, door, 1.1)
    return replace(
        plan,
        extent=Rect(0, 0, width, beyond),
        rooms=tuple(rooms),
        walls=walls,
        openings=(*plan.openings, opening),
        flight=flight,
    )


def _to_the_far_room(plan: Plan) -> tuple[TrajectoryCorner, ...]:
    """From the end of a full building's tour to the room in the middle of its far side."""
    into = max((o for o in plan.openings if o.along == "x"), key=lambda o: o.line)
    return TrajectoryCorner(into.center, plan.trajectory_corners[-1].y), TrajectoryCorner(
        into.center, into.line + ENTRY
    )


def _to_the_near_room(plan: Plan) -> tuple[TrajectoryCorner, ...]:
    """From the end of a full building's tour, and from its beginning, to the room in its far corner."""
    end = plan.trajectory_corners[-1]
    into = min((o for o in plan.openings if o.along == "y" and o.center == end.y), key=lambda o: o.line)
    return end, TrajectoryCorner(into.line - ENTRY, end.y)
