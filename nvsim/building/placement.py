"""Placement of furniture: along walls or free-standing, never in a doorway or near the trajectory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.building.config import Style
from nvsim.building.furniture import Piece, pieces
from nvsim.building.plan import OUTER_WALL, Plan, Rect, Room
from nvsim.building.solids import BACK, BOTTOM, FRONT, LEFT, RIGHT, TOP, Box

_CLEARANCE = 0.48  # meters between the trajectory and any furniture
_TURNED_FACES = (
    {f: f for f in range(6)},
    {LEFT: FRONT, FRONT: RIGHT, RIGHT: BACK, BACK: LEFT, TOP: TOP, BOTTOM: BOTTOM},
    {LEFT: RIGHT, RIGHT: LEFT, FRONT: BACK, BACK: FRONT, TOP: TOP, BOTTOM: BOTTOM},
    {LEFT: BACK, BACK: RIGHT, RIGHT: FRONT, FRONT: LEFT, TOP: TOP, BOTTOM: BOTTOM},
)


def furnish(plan: Plan, walk: NDArray[np.float64], rng: np.random.Generator, style: Style) -> list[Box]:
    """The boxes of all furniture; `walk` is (N, 2+) with x, y in meters."""
    boxes: list[Box] = []
    taken: list[Rect] = [o.rect(1.1) for o in plan.openings]
    track = walk[::5, :2]
    for room in plan.rooms:
        for make, at_wall in pieces(room.kind, style):
            boxes += _try(plan, room, make(rng), taken, track, rng, at_wall=at_wall)
    return boxes


def _try(
    plan: Plan,
    room: Room,
    piece: Piece,
    taken: list[Rect],
    track: NDArray[np.float64],
    rng: np.random.Generator,
    at_wall: bool,
) -> list[Box]:
    """The boxes of the piece at the first of sixty random places that is free; none if all are taken."""
    area = room.rects[0].grown(-OUTER_WALL / 2 - 0.01)
    for _ in range(60):
        turns = int(rng.integers(4))
        w, d = (piece.width, piece.depth) if turns % 2 == 0 else (piece.depth, piece.width)
        if area.x1 - area.x0 <= w or area.y1 - area.y0 <= d:
            continue
        x, y = float(rng.uniform(area.x0, area.x1 - w)), float(rng.uniform(area.y0, area.y1 - d))
        if at_wall:
            # The back of a piece (its y = 0) faces, after 0 to 3 quarter turns, -y, +x, +y, -x
            x, y = ((x, area.y0), (area.x1 - w, y), (x, area.y1 - d), (area.x0, y))[turns]
        spot = Rect(x, y, x + w, y + d)
        margin = 0.04 if at_wall else 0.35
        if any(spot.grown(margin).overlaps(t) for t in taken) or _distance(spot, track) < _CLEARANCE:
            continue
        taken.append(spot)
        return [_placed(b, piece, turns, x, y) for b in piece.boxes]
    return []


def _distance(spot: Rect, track: NDArray[np.float64]) -> float:
    dx = np.maximum(np.maximum(spot.x0 - track[:, 0], track[:, 0] - spot.x1), 0)
    dy = np.maximum(np.maximum(spot.y0 - track[:, 1], track[:, 1] - spot.y1), 0)
    return float(np.hypot(dx, dy).min())


def _placed(box: Box, piece: Piece, turns: int, x: float, y: float) -> Box:
    """A box of the piece after `turns` quarter turns (counter-clockwise), with the corner of the footprint at x, y."""
    (ax, ay, az), (bx, by, bz) = box.lo, box.hi
    w, d = piece.width, piece.depth
    x0, y0, x1, y1 = (
        (ax, ay, bx, by),
        (d - by, ax, d - ay, bx),
        (w - bx, d - by, w - ax, d - ay),
        (ay, w - bx, by, w - ax),
    )[turns]
    faces = tuple((_TURNED_FACES[turns][f], p) for f, p in box.faces)

    def on_raster(v: float) -> float:
        return round(v * 1000) / 1000

    return Box(
        (on_raster(x + x0), on_raster(y + y0), az),
        (on_raster(x + x1), on_raster(y + y1), bz),
        box.paint,
        faces,
        box.glass,
    )
