"""Build a clinic for hand-held videos: long corridors, identical doors every 3.6 m, and nearly bare walls.

Two corridors along x are joined by a cross corridor at each end. They form a ring around a core of rooms.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.building import BuildingConfig
from nvsim.building.layouts import ENTRY, outer_walls
from nvsim.building.painting import Image, paint_face, paint_floor, smooth_noise
from nvsim.building.placement import furnish
from nvsim.building.plan import INNER_WALL, Opening, Plan, Rect, Room, Storey, TrajectoryCorner, Wall
from nvsim.building.raycast import make_solids
from nvsim.building.scene import Scene, path, with_floor_heights
from nvsim.building.solids import BACK, LEFT, TOP, Box, Color, Paint, wall_boxes

Route = Literal["corridor", "loop"]
PITCH = 3.6  # meters between doors
_ROOM, _CORRIDOR = 4.0, 2.2  # depth of an outer room and width of a corridor, meters
_SIZE: dict[Route, tuple[float, float]] = {"corridor": (28.8, 8.0), "loop": (36.0, 11.0)}
_WALLS: tuple[Color, ...] = ((0.74, 0.75, 0.72), (0.75, 0.73, 0.66), (0.68, 0.73, 0.75))
_METAL, _RED, _DARK = (0.55, 0.56, 0.58), (0.62, 0.10, 0.08), (0.16, 0.17, 0.19)
_MIRRORED = "mirrored "
_WORDS = ("Ward", "Station", "Lab", "X-ray", "Exit", "Surgery", "Office", "Waiting", "Visitors", "Clinic", "Notice")


def make_clinic(route: Route, seed: int) -> Scene:
    """Builds the clinic with a route: "corridor" along both corridors and into one room, "loop" once around the
    ring."""
    rng = np.random.default_rng([seed, 7])
    plan, doors = _plan(route, rng)
    dense = with_floor_heights(path(plan.trajectory_corners), None)
    wall = _WALLS[int(rng.integers(len(_WALLS)))]
    accent = tuple(float(v) for v in np.clip(np.array(wall) * rng.uniform(0.7, 0.85, 3), 0, 1))
    paints = {r.name: Paint("wall-clinic", wall, (accent[0], accent[1], accent[2])) for r in plan.rooms}
    frame = Paint("plain", (0.52, 0.53, 0.55))
    boxes = [*wall_boxes(plan, paints, frame), *furnish(plan, dense, rng, "furnished")]
    boxes += _leaves(doors, rng) + _fittings(plan, rng)
    boxes = [_readable(b) for b in boxes]
    storeys = (Storey(plan, 0.0),)
    config = BuildingConfig(seed=seed, people=False)
    return Scene(config, storeys, dense, dense, tuple(boxes), make_solids(storeys, boxes), ())


def _plan(route: Route, rng: np.random.Generator) -> tuple[Plan, list[Opening]]:
    """Returns the plan and the openings with closed doors."""
    length, core = _SIZE[route]
    y1, y2 = _ROOM, _ROOM + _CORRIDOR
    y3, y4 = y2 + core, y2 + core + _CORRIDOR
    depth, middle = y4 + _ROOM, y2 + core / 2
    x1, x2 = _CORRIDOR, length - _CORRIDOR
    rows = [(y1, 0.0, 0.0, length), (y2, middle, x1, x2), (y3, middle, x1, x2), (y4, depth, 0.0, length)]
    walls = [*outer_walls(length, depth), Wall("y", x1, y2, y3), Wall("y", x2, y2, y3), Wall("x", middle, x1, x2)]
    ring = (Rect(0, y1, length, y2), Rect(0, y3, length, y4), Rect(0, y2, x1, y3), Rect(x2, y2, length, y3))
    rooms, openings, closed = [Room("corridor", "corridor", "tiles", ring)], [], []
    for k, (front, back, start, end) in enumerate(rows):
        walls.append(Wall("x", front, start, end))
        count = int((end - start) // PITCH)
        edges = [start + i * (end - start) / count for i in range(count + 1)]
        for i, (a, b) in enumerate(zip(edges, edges[1:])):
            opening = Opening("x", front, round((a + b) / 2, 2), 1.0)
            visited = (k, i) in ((0, 3), (3, 4))
            kind = str(rng.choice(["office", "lounge", "library"])) if visited else "closed"
            rooms.append(Room(f"room {k}{i}", kind, "tiles", (Rect(a, min(front, back), b, max(front, back)),)))
            openings.append(opening)
            if not visited:
                closed.append(opening)
            if i:
                walls.append(Wall("y", a, min(front, back), max(front, back)))
    stops = _stops(route, length, (y1 + y2) / 2, (y3 + y4) / 2, [o for o in openings if o not in closed])
    return Plan(Rect(0, 0, length, depth), tuple(rooms), tuple(walls), tuple(openings), tuple(stops)), closed


def _stops(route: Route, length: float, low: float, high: float, visits: list[Opening]) -> list[TrajectoryCorner]:
    west, east = _CORRIDOR / 2, length - _CORRIDOR / 2
    if route == "loop":
        around = [
            TrajectoryCorner(east, low),
            TrajectoryCorner(east, high),
            TrajectoryCorner(west, high),
            TrajectoryCorner(west, low),
        ]
        return [TrajectoryCorner(10.0, low - 0.1), *around, TrajectoryCorner(17.0, low + 0.1)]
    door = visits[0]
    inside = TrajectoryCorner(door.center, door.line - ENTRY)
    visit = [
        TrajectoryCorner(door.center, low),
        inside,
        TrajectoryCorner(door.center + 0.2, door.line - 2.0),
        inside,
        TrajectoryCorner(door.center, low),
    ]
    return [
        TrajectoryCorner(2.5, low),
        *visit,
        TrajectoryCorner(east, low - 0.1),
        TrajectoryCorner(east, high),
        TrajectoryCorner(2.5, high - 0.1),
    ]


def _leaves(doors: list[Opening], rng: np.random.Generator) -> list[Box]:
    """Closed doors, each with a number plate next to it on both sides of the wall."""
    color: Color = ((0.60, 0.46, 0.31), (0.45, 0.52, 0.55), (0.66, 0.62, 0.50))[int(rng.integers(3))]
    boxes = []
    for k, o in enumerate(doors):
        paint = Paint("door", color)
        boxes.append(Box((o.center - 0.5, o.line - 0.03, 0.01), (o.center + 0.5, o.line + 0.03, 2.06), paint))
        boxes.append(_plate(o.line, o.center + 0.72, 0.17, 1.48, 1.62, f"label:{101 + k}", _METAL, 0.075))
    return boxes


def _plate(line: float, x: float, width: float, low: float, high: float, kind: str, color: Color, out: float) -> Box:
    """A thin box through the wall y = `line`, seen from both sides."""
    return Box((x - width / 2, line - out, low), (x + width / 2, line + out, high), Paint(kind, color))


def _fittings(plan: Plan, rng: np.random.Generator) -> list[Box]:
    """Pictures, notice boards, benches, carts and extinguishers between the doors, and signs under the ceiling."""
    boxes: list[Box] = []
    ring = plan.rooms[0].rects
    for room in plan.rooms[1:]:
        edge, corridor = room.rects[0].x0, next(r for r in ring[:2] if _borders(room.rects[0], r))
        if not 1.5 < edge < plan.extent.x1 - 1.5:
            continue
        below = room.rects[0].y0 < corridor.y0
        line, sign = (corridor.y0, 1.0) if below else (corridor.y1, -1.0)
        wall, x = line + sign * INNER_WALL / 2, edge + float(rng.uniform(-0.25, 0.25))
        if rng.random() < 0.45:
            w, h = float(rng.uniform(0.4, 0.9)), float(rng.uniform(0.45, 0.8))
            kind = str(rng.choice(["print", "notices"]))
            boxes.append(_against(wall, sign, x, w, 0.03, 1.2, 1.2 + h, Paint(kind, _DARK)))
        if rng.random() < 0.35:
            boxes += _standing(wall, sign, x, rng)
    for i, r in enumerate(ring):
        x, y = r.center
        signs = [(x + s, y) for s in (-9.0, 2.0)] if i < 2 else [(x, y + 2.0)]
        for u, v in signs:
            half = (0.03, 0.5) if i < 2 else (0.5, 0.03)
            paint = Paint(f"label:{rng.choice(_WORDS)} {int(rng.integers(1, 30))}", (0.12, 0.26, 0.40), (0.9, 0.9, 0.9))
            boxes.append(Box((u - half[0], v - half[1], 2.32), (u + half[0], v + half[1], 2.56), paint))
    for x, sign in ((0.1, 1.0), (plan.extent.x1 - 0.1, -1.0)):  # the ends of the corridors
        for r in ring[:2]:
            near, far = sorted((x, x + sign * 0.03))
            y = r.center[1] + float(rng.uniform(-0.3, 0.3))
            boxes.append(
                Box((near, y - 0.4, 1.15), (far, y + 0.4, 1.75), Paint(str(rng.choice(["print", "notices"])), _DARK))
            )
    return boxes


def _readable(box: Box) -> Box:
    """The box, with its text mirrored on the two sides where an image runs from right to left."""
    kind = box.paint.kind
    if kind != "notices" and not kind.startswith("label:"):
        return box
    mirrored = replace(box.paint, kind=f"{_MIRRORED}{kind}")
    return replace(box, faces=((LEFT, mirrored), (BACK, mirrored)))


def _borders(room: Rect, corridor: Rect) -> bool:
    return room.y1 == corridor.y0 or room.y0 == corridor.y1


def _against(wall: float, sign: float, x: float, w: float, d: float, low: float, high: float, paint: Paint) -> Box:
    near, far = sorted((wall, wall + sign * d))
    return Box((round(x - w / 2, 3), round(near, 3), low), (round(x + w / 2, 3), round(far, 3), round(high, 3)), paint)


def _standing(wall: float, sign: float, x: float, rng: np.random.Generator) -> list[Box]:
    """A bench, a cart, a plant or an extinguisher at a wall."""
    what = int(rng.integers(4))
    if what == 0:
        cloth = Paint("cloth", ((0.28, 0.38, 0.52), (0.36, 0.46, 0.34))[int(rng.integers(2))])
        seats = [_against(wall, sign, x + s, 0.46, 0.45, 0.40, 0.47, cloth) for s in (-0.5, 0.0, 0.5)]
        backs = [_against(wall, sign, x + s, 0.46, 0.06, 0.47, 0.86, cloth) for s in (-0.5, 0.0, 0.5)]
        legs = [_against(wall, sign, x + s, 0.04, 0.40, 0.0, 0.40, Paint("plain", _DARK)) for s in (-0.6, 0.6)]
        return seats + backs + legs
    if what == 1:
        cart = Paint("drawers", (0.62, 0.66, 0.70))
        top = Paint("desk", (0.7, 0.7, 0.7), (0.3, 0.4, 0.6))
        body = _against(wall, sign, x, 0.85, 0.48, 0.1, 0.95, cart)
        return [replace(body, faces=((TOP, top),))]
    if what == 2:
        pot, leaves = Paint("cloth", (0.5, 0.3, 0.25)), Paint("leaves", (0.24, 0.42, 0.20))
        return [
            _against(wall, sign, x, 0.32, 0.32, 0, 0.36, pot),
            _against(wall, sign, x, 0.44, 0.42, 0.4, 1.2, leaves),
        ]
    return [
        _against(wall, sign, x + 0.6, 0.15, 0.15, 0.75, 1.2, Paint("label:FIRE", _RED, (0.9, 0.9, 0.9))),
        _against(wall, sign, x + 0.6, 0.2, 0.02, 1.45, 1.65, Paint("label:!", _RED, (0.95, 0.95, 0.95))),
    ]


def clinic_floor(plan: Plan, texel: float, rng: np.random.Generator) -> tuple[Image, NDArray[np.float32]]:
    """The floor (R, C, 3) with speckled linoleum and a dark border in the corridors, and its gloss (R, C)."""
    image, gloss = paint_floor(plan, texel, rng)
    for room in plan.rooms:
        for r in room.rects if room.kind == "corridor" else ():
            r0, r1, c0, c1 = (round(v / texel) for v in (r.y0, r.y1, r.x0, r.x1))
            rows, columns = image[r0:r1, c0:c1].shape[:2]
            speckle = smooth_noise(rows, columns, (2.0, 2.0), rng) * 0.035
            worn = smooth_noise(rows, columns, (0.7 / texel, 0.7 / texel), rng) * 0.02
            image[r0:r1, c0:c1] = np.array((0.50, 0.53, 0.52), np.float32) * (1 + speckle + worn)[..., None]
    return image, gloss


def clinic_ceiling(plan: Plan, texel: float, rng: np.random.Generator) -> Image:
    """A ceiling (R, C, 3) of mineral tiles of 0.6 m in a grid; a few have a stain or a vent."""
    rows, columns = round(plan.extent.y1 / texel), round(plan.extent.x1 / texel)
    image = np.full((rows, columns, 3), (0.80, 0.80, 0.78), np.float32)
    image *= (1 + 0.012 * smooth_noise(rows, columns, (2.0, 2.0), rng))[..., None]
    tile = round(0.6 / texel)
    for r in range(0, rows, tile):
        for c in range(0, columns, tile):
            image[r : r + tile, c : c + tile] *= np.float32(rng.uniform(0.96, 1.0))
            if rng.random() < 0.03:
                image[r + 3 : r + tile - 3 : 3, c + 3 : c + tile - 3] *= np.float32(0.55)
    image[::tile], image[:, ::tile] = 0.66, 0.66
    return image


def detailed_face(
    paint: Paint, at: tuple[float, float], width: float, height: float, texel: float, rng: np.random.Generator
) -> Image:
    """The texture (R, C, 3) of a face: like `painting.paint_face`, with fittings of a clinic and fine grain."""
    if paint.kind.startswith(_MIRRORED):
        straight = replace(paint, kind=paint.kind.removeprefix(_MIRRORED))
        return np.ascontiguousarray(detailed_face(straight, at, width, height, texel, rng)[:, ::-1])
    rows, columns = max(2, round(height / texel)), max(2, round(width / texel))
    kind, _, text = paint.kind.partition(":")
    if kind == "wall-clinic":
        image = _bare_wall(rows, columns, at, texel, paint, rng)
    elif kind == "door":
        image = _door(rows, columns, paint, rng)
    elif kind == "label":
        image = _label(rows, columns, text, paint)
    elif kind in ("print", "notices"):
        image = _print(rows, columns, rng) if kind == "print" else _notices(rows, columns, texel, rng)
    else:
        image = np.array(paint_face(paint, at, width, height, texel, rng), np.float32)
    if min(rows, columns) > 8:
        grain = 0.006 if kind.startswith("wall") else 0.03 if kind in ("wood", "cloth", "desk", "drawers") else 0.012
        image *= (1 + grain * smooth_noise(rows, columns, (2.0, 2.0), rng))[..., None]
        image *= (1 + 0.7 * grain * smooth_noise(rows, columns, (9.0, 7.0), rng))[..., None]
    return np.asarray(np.clip(image, 0, 1), np.float32)


def _bare_wall(
    rows: int, columns: int, at: tuple[float, float], texel: float, paint: Paint, rng: np.random.Generator
) -> Image:
    """Paint in two tones with a rail between them, a skirting board, and a few scuffs."""
    image = np.broadcast_to(np.array(paint.color, np.float32), (rows, columns, 3)).copy()
    height = at[1] + (np.arange(rows) + 0.5) * texel
    image[height < 0.95] = paint.accent
    image[(height > 0.86) & (height < 0.98)] = (0.48, 0.40, 0.32)
    image[height < 0.1] = (0.33, 0.33, 0.34)
    for _ in range(rng.poisson(columns * texel * 0.8)):
        x, y = int(rng.integers(columns)), float(rng.uniform(0.1, 1.1)) - at[1]
        if 0 < y / texel < rows:
            end = (x + int(rng.normal(0, 0.08 / texel)), int(y / texel + rng.normal(0, 0.03 / texel)))
            cv2.line(image, (x, int(y / texel)), end, [float(v) * 0.8 for v in paint.accent], 1, cv2.LINE_AA)
    return image


def _door(rows: int, columns: int, paint: Paint, rng: np.random.Generator) -> Image:
    """A leaf with grain, a metal kick plate, a handle, and sometimes a narrow window."""
    image = np.array(paint_face(Paint("wood", paint.color), (0, 0), columns, rows, 1.0, rng), np.float32)
    image[...] = np.array(paint.color, np.float32)
    image *= (1 + 0.05 * smooth_noise(rows, columns, (max(rows / 4, 2), max(columns / 40, 1.5)), rng))[..., None]
    if columns < 20:
        return image
    image[: rows // 8] = _METAL
    image[rows // 2 - rows // 30 : rows // 2 + rows // 20, columns // 16 : columns // 10] = _METAL
    image[rows // 2 : rows // 2 + max(rows // 80, 2), columns // 16 : columns // 5] = (0.3, 0.3, 0.32)
    if rng.random() < 0.3:
        image[rows * 5 // 9 : rows * 8 // 9, columns * 3 // 4 : columns * 7 // 8] = (0.15, 0.18, 0.2)
    return image


def _text(image: Image, text: str, x: int, y: int, scale: float, color: Color, thick: int = 1) -> None:
    """Writes on an image whose first row is the lowest."""
    ink = np.zeros(image.shape[:2], np.uint8)
    cv2.putText(ink, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, scale, (255,), thick, cv2.LINE_AA)
    image += (ink[::-1, :, None] / np.float32(255)) * (np.array(color, np.float32) - image)


def _label(rows: int, columns: int, text: str, paint: Paint) -> Image:
    image = np.broadcast_to(np.array(paint.color, np.float32), (rows, columns, 3)).copy()
    if min(rows, columns) < 8:
        return image
    (w, h), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 1.0, 2)
    scale = min(0.8 * columns / w, 0.6 * rows / h)
    place = int((columns - scale * w) / 2), int((rows + scale * h) / 2)
    _text(image, text, *place, scale, paint.accent, max(1, round(2 * scale)))
    return image


def _print(rows: int, columns: int, rng: np.random.Generator) -> Image:
    """A framed picture: random clouds of color and shapes."""
    image = np.empty((rows, columns, 3), np.float32)
    light = 0.10 * smooth_noise(rows, columns, (max(rows / 5, 2), max(columns / 5, 2)), rng)
    for c in range(3):
        big = smooth_noise(rows, columns, (max(rows / 3, 2), max(columns / 3, 2)), rng)
        small = smooth_noise(rows, columns, (max(rows / 14, 2), max(columns / 14, 2)), rng)
        image[..., c] = 0.45 + light + 0.06 * big + 0.03 * small
    if min(rows, columns) < 16:
        return image
    for _ in range(14):
        color = [float(v) for v in rng.uniform(0.2, 0.75) + rng.uniform(-0.12, 0.12, 3)]
        at = int(rng.integers(columns)), int(rng.integers(rows))
        axes = int(rng.uniform(2, columns / 6)), int(rng.uniform(2, rows / 6))
        cv2.ellipse(image, at, axes, float(rng.uniform(0, 180)), 0, 360, color, -1, cv2.LINE_AA)
    edge = max(2, round(0.05 * rows))
    for part in (image[:edge], image[-edge:], image[:, :edge], image[:, -edge:]):
        part[...] = (0.18, 0.15, 0.12)
    return image


def _notices(rows: int, columns: int, texel: float, rng: np.random.Generator) -> Image:
    """A board with sheets of paper, a heading and lines of text on each."""
    image = np.broadcast_to(np.array((0.48, 0.40, 0.28), np.float32), (rows, columns, 3)).copy()
    if min(rows, columns) < 16:
        return image
    w, h = round(0.21 / texel), round(0.29 / texel)
    for x in range(4, columns - w, w + 3):
        for y in range(4, rows - h, h + 3):
            if rng.random() < 0.25:
                continue
            sheet = image[y : y + h, x : x + w]
            sheet[...] = rng.uniform(0.72, 0.88) + rng.uniform(-0.06, 0.02, 3)
            for line in range(3, h - max(h // 4, 6), 4):
                sheet[line : line + 2, 3 : 3 + int((w - 6) * rng.uniform(0.4, 1.0))] *= np.float32(0.55)
            _text(sheet, str(rng.choice(_WORDS)), 3, max(h // 6, 6), w / 130, (0.1, 0.1, 0.3))
    return image
