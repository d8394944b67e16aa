"""The furniture: a catalog of pieces, and their places along walls or free-standing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.building.config import Style
from nvsim.building.plan import OUTER_WALL, Plan, Rect, Room
from nvsim.building.solids import BACK, BOTTOM, FRONT, LEFT, RIGHT, TOP, Box, Color, Paint

_WOODS: tuple[Color, ...] = ((0.62, 0.46, 0.30), (0.50, 0.34, 0.22), (0.74, 0.60, 0.42), (0.80, 0.78, 0.74))
_CLOTHS: tuple[Color, ...] = ((0.28, 0.38, 0.52), (0.55, 0.30, 0.26), (0.36, 0.46, 0.34), (0.58, 0.54, 0.46))
_DARK = Paint("plain", (0.16, 0.17, 0.19))


@dataclass(frozen=True)
class FurniturePiece:
    """Boxes of a piece of furniture on a footprint of `width` x `depth` meters."""

    width: float
    depth: float
    boxes: tuple[Box, ...]


def _pick(rng: np.random.Generator, colors: tuple[Color, ...]) -> Color:
    c = np.clip(np.array(colors[int(rng.integers(len(colors)))]) + rng.uniform(-0.05, 0.05), 0.05, 0.95)
    return float(c[0]), float(c[1]), float(c[2])


def _block(
    x0: float, y0: float, z0: float, x1: float, y1: float, z1: float, paint: Paint, *faces: tuple[int, Paint]
) -> Box:
    return Box((x0, y0, z0), (x1, y1, z1), paint, faces)


def _legs(w: float, d: float, height: float, thick: float, paint: Paint) -> list[Box]:
    return [
        _block(x, y, 0.0, x + thick, y + thick, height, paint)
        for x in (0.03, w - 0.03 - thick)
        for y in (0.03, d - 0.03 - thick)
    ]


def _desk(rng: np.random.Generator) -> FurniturePiece:
    w, d = float(rng.uniform(1.3, 1.6)), 0.7
    wood = Paint("wood", _pick(rng, _WOODS))
    top = Paint("desk", wood.color, _pick(rng, _CLOTHS))
    x = w / 2
    screen = Paint("screen", (0.16, 0.2, 0.26), _pick(rng, _CLOTHS))
    return FurniturePiece(
        w,
        d + 0.65,
        (
            _block(0, 0, 0.70, w, d, 0.74, wood, (TOP, top)),
            _block(0, 0.02, 0, 0.03, d - 0.02, 0.70, wood),
            _block(w - 0.42, 0.05, 0, w, d - 0.02, 0.70, wood, (BACK, Paint("drawers", wood.color))),
            _block(x - 0.27, 0.16, 0.86, x + 0.27, 0.20, 1.19, _DARK, (BACK, screen)),
            _block(x - 0.04, 0.17, 0.74, x + 0.04, 0.20, 0.86, _DARK),
            *_chair_boxes(rng, x - 0.32, d + 0.08, facing_wall=True),
        ),
    )


def _chair_boxes(rng: np.random.Generator, x: float, y: float, facing_wall: bool) -> list[Box]:
    cloth = Paint("cloth", _pick(rng, _CLOTHS))
    back = y + 0.41 if facing_wall else y
    boxes = [
        _block(x, y, 0.42, x + 0.46, y + 0.46, 0.48, cloth),
        _block(x, back, 0.48, x + 0.46, back + 0.05, 0.92, cloth),
    ]
    for lx in (x + 0.02, x + 0.40):
        for ly in (y + 0.02, y + 0.40):
            boxes.append(_block(lx, ly, 0, lx + 0.04, ly + 0.04, 0.42, _DARK))
    return boxes


def _shelf(rng: np.random.Generator) -> FurniturePiece:
    w, h = float(rng.uniform(1.0, 1.8)), float(rng.uniform(1.7, 2.1))
    wood = Paint("wood", _pick(rng, _WOODS))
    return FurniturePiece(w, 0.34, (_block(0, 0, 0, w, 0.34, h, wood, (BACK, Paint("books", wood.color))),))


def _low_shelf(rng: np.random.Generator) -> FurniturePiece:
    w = float(rng.uniform(1.0, 1.6))
    wood = Paint("wood", _pick(rng, _WOODS))
    return FurniturePiece(
        w,
        0.38,
        (
            _block(0, 0, 0, w, 0.38, 0.84, wood, (BACK, Paint("books", wood.color))),
            _block(0.1, 0.08, 0.84, 0.36, 0.28, 1.1, Paint("cloth", _pick(rng, _CLOTHS))),
        ),
    )


def _cabinet(rng: np.random.Generator) -> FurniturePiece:
    w, h = float(rng.uniform(0.8, 1.2)), float(rng.uniform(0.9, 1.4))
    wood = Paint("wood", _pick(rng, _WOODS))
    return FurniturePiece(w, 0.45, (_block(0, 0, 0, w, 0.45, h, wood, (BACK, Paint("drawers", wood.color))),))


def _sofa(rng: np.random.Generator) -> FurniturePiece:
    w = float(rng.uniform(1.7, 2.1))
    cloth = Paint("cloth", _pick(rng, _CLOTHS))
    cushion = Paint("cloth", _pick(rng, _CLOTHS))
    return FurniturePiece(
        w,
        0.85,
        (
            _block(0, 0, 0.04, w, 0.85, 0.42, cloth),
            _block(0, 0, 0.42, w, 0.22, 0.82, cloth),
            _block(0, 0.22, 0.42, 0.2, 0.85, 0.60, cloth),
            _block(w - 0.2, 0.22, 0.42, w, 0.85, 0.60, cloth),
            _block(0.28, 0.22, 0.42, 0.70, 0.36, 0.78, cushion),
        ),
    )


def _low_table(rng: np.random.Generator) -> FurniturePiece:
    w, d = float(rng.uniform(0.9, 1.2)), float(rng.uniform(0.5, 0.7))
    wood = Paint("wood", _pick(rng, _WOODS))
    top = Paint("desk", wood.color, _pick(rng, _CLOTHS))
    return FurniturePiece(w, d, (_block(0, 0, 0.35, w, d, 0.40, wood, (TOP, top)), *_legs(w, d, 0.35, 0.06, wood)))


def _table(rng: np.random.Generator) -> FurniturePiece:
    w, d = float(rng.uniform(1.4, 1.8)), 0.85
    wood = Paint("wood", _pick(rng, _WOODS))
    top = Paint("desk", wood.color, _pick(rng, _CLOTHS))
    boxes = [_block(0, 0.5, 0.70, w, 0.5 + d, 0.74, wood, (TOP, top))]
    boxes += [_shift_box(b, 0.5) for b in _legs(w, d, 0.70, 0.07, wood)]
    for x in (0.12, w - 0.58):
        boxes += _chair_boxes(rng, x, 0.02, facing_wall=False)
        boxes += _chair_boxes(rng, x, d + 0.52, facing_wall=True)
    return FurniturePiece(w, d + 1.0, tuple(boxes))


def _shift_box(box: Box, y: float) -> Box:
    return Box((box.lo[0], box.lo[1] + y, box.lo[2]), (box.hi[0], box.hi[1] + y, box.hi[2]), box.paint, box.faces)


def _counter(rng: np.random.Generator) -> FurniturePiece:
    w = float(rng.uniform(2.0, 2.6))
    body = Paint("drawers", _pick(rng, _WOODS))
    stone = Paint("stone", (0.42, 0.42, 0.44))
    over = Paint("drawers", body.color)
    return FurniturePiece(
        w,
        0.62,
        (
            _block(0, 0, 0, w, 0.60, 0.86, body),
            _block(0, 0, 0.86, w, 0.62, 0.90, stone),
            _block(0, 0, 1.45, w, 0.35, 2.15, over),
        ),
    )


def _fridge(rng: np.random.Generator) -> FurniturePiece:
    return FurniturePiece(0.65, 0.65, (_block(0, 0, 0, 0.65, 0.65, 1.8, Paint("drawers", (0.78, 0.79, 0.80))),))


def _plant(rng: np.random.Generator) -> FurniturePiece:
    pot = Paint("plain", _pick(rng, _CLOTHS))
    leaves = Paint("leaves", (0.24, 0.42, 0.20))
    h = float(rng.uniform(0.9, 1.5))
    return FurniturePiece(
        0.5,
        0.5,
        (
            _block(0.1, 0.1, 0, 0.4, 0.4, 0.36, pot),
            _block(0.0, 0.06, 0.42, 0.5, 0.44, h, leaves),
            _block(0.06, 0.0, 0.36, 0.44, 0.5, h + 0.12, leaves),
        ),
    )


def _cartons(rng: np.random.Generator) -> FurniturePiece:
    card = Paint("carton", (0.66, 0.52, 0.36))
    h = float(rng.uniform(0.3, 0.45))
    return FurniturePiece(
        0.8,
        0.5,
        (
            _block(0, 0, 0, 0.5, 0.45, h, card),
            _block(0.05, 0.03, h, 0.4, 0.35, h + 0.28, card),
            _block(0.53, 0.05, 0, 0.8, 0.4, 0.25, card),
        ),
    )


def _platform(rng: np.random.Generator) -> FurniturePiece:
    """A stage of one step, 15 cm high."""
    w, d = float(rng.uniform(1.6, 2.0)), float(rng.uniform(1.0, 1.2))
    return FurniturePiece(w, d, (_block(0, 0, 0, w, d, 0.15, Paint("wood", _pick(rng, _WOODS), (0.3, 0.2, 0.1))),))


def _glass_screen(rng: np.random.Generator) -> FurniturePiece:
    """A pane on two feet, which are too low to count as obstacles in a LiDAR scan."""
    w = float(rng.uniform(1.2, 1.6))
    metal = Paint("plain", (0.38, 0.39, 0.41))
    feet = [_block(x, 0, 0, x + 0.08, 0.4, 0.04, metal) for x in (0.1, w - 0.18)]
    pane = Box((0, 0.19, 0.02), (w, 0.21, 1.8), metal, glass=True)
    return FurniturePiece(w, 0.4, (*feet, pane))


Maker = Callable[[np.random.Generator], FurniturePiece]
_AT_WALL: dict[str, tuple[Maker, ...]] = {
    "office": (_desk, _desk, _shelf, _desk, _cabinet, _platform, _plant, _low_shelf, _cartons),
    "lounge": (_sofa, _low_shelf, _platform, _plant, _sofa, _cabinet, _shelf),
    "library": (_shelf, _shelf, _shelf, _platform, _shelf, _low_shelf, _desk, _low_shelf, _plant),
    "kitchen": (_counter, _fridge, _cabinet, _plant, _low_shelf, _cartons),
    "hall": (_platform, _sofa, _plant, _cabinet, _shelf, _cartons, _plant, _low_shelf),
    "meeting": (_cabinet, _plant),
}
_FREE_STANDING: dict[str, tuple[Maker, ...]] = {
    "office": (_low_table,),
    "lounge": (_low_table, _table),
    "library": (_table, _low_table),
    "kitchen": (_table, _low_table),
    "hall": (_low_table, _low_table),
    "meeting": (_low_table,),
}


def pieces(kind: str, style: Style) -> list[tuple[Maker, bool]]:
    """The furniture of a kind of room, in order of placement, and whether each piece is placed at a wall. A bare room
    has one piece. In a building of glass, a screen comes first."""
    at_wall = [(make, True) for make in _AT_WALL.get(kind, ())]
    free = [(make, False) for make in _FREE_STANDING.get(kind, ())]
    if style == "bare":
        return at_wall[:1]
    return ([(_glass_screen, False)] if style == "glass" and free else []) + at_wall + free


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
    piece: FurniturePiece,
    taken: list[Rect],
    track: NDArray[np.float64],
    rng: np.random.Generator,
    at_wall: bool,
) -> list[Box]:
    """The boxes of the piece at the first of sixty random places that is free; none if all are taken."""
    area = room.rects[0].expanded(-OUTER_WALL / 2 - 0.01)
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
        if any(spot.expanded(margin).overlaps(t) for t in taken) or _distance(spot, track) < _CLEARANCE:
            continue
        taken.append(spot)
        return [_place_box(b, piece, turns, x, y) for b in piece.boxes]
    return []


def _distance(spot: Rect, track: NDArray[np.float64]) -> float:
    dx = np.maximum(np.maximum(spot.x0 - track[:, 0], track[:, 0] - spot.x1), 0)
    dy = np.maximum(np.maximum(spot.y0 - track[:, 1], track[:, 1] - spot.y1), 0)
    return float(np.hypot(dx, dy).min())


def _place_box(box: Box, piece: FurniturePiece, turns: int, x: float, y: float) -> Box:
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
