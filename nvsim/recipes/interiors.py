"""Generated interiors: buildings of the generator with random surfaces, more clutter and people, and random cameras."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nvsim.building.baking import Painters, bake
from nvsim.building.config import BuildingConfig, Style
from nvsim.building.plan import HEIGHT, Rect
from nvsim.building.raycast import make_solids
from nvsim.building.rendering import View, render
from nvsim.building.scene import Scene, make_scene
from nvsim.building.solids import Box, Paint
from nvsim.building.truth import floor_mask, normals
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.recipes.examples import SIZE, Example
from nvsim.recipes.patterns import color, paint_anew, paint_ceiling, paint_floor, paint_pale

FIRST_SEED = 1000
"""Seeds below this are never used for training, because demos and tests use them."""
_NEAREST = 0.35  # meters; images with a smaller median depth are not used
_AT_FURNITURE = 0.4  # share of the cameras that are held at furniture
_TRIES = 1000  # camera positions that are tested per view


def interior(number: int, count: int, upright: bool) -> list[Example]:
    """`count` views of the building with this number; all are `upright` or none is. Deterministic.

    Raises InputError if the building has too few usable camera positions.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([31, number])))
    scene = _scene(number, rng)
    painters = Painters(paint_floor, paint_pale if rng.random() < 0.35 else paint_anew, paint_ceiling)
    textures = bake(scene.storeys, list(scene.boxes), scene.solids, rng, painters)
    found: list[Example] = []
    for camera in _cameras(scene, rng, upright, _TRIES * count):
        people, clothes = _crowd(scene, camera, rng)
        view = render(camera, scene.solids, textures, people, clothes)
        if np.median(view.depth) < _NEAREST:
            continue
        image = np.rint(np.clip(view.color, 0, 1) * 255).astype(np.uint8)
        floor = floor_mask(scene, view).astype(np.uint8)
        found.append(Example(image, floor, _normals(scene, view, camera, people), camera))
        if len(found) == count:
            return found
    raise InputError(
        f"Only {len(found)} of {count} views of the generated building {number} are usable; train with --interiors "
        f"{number} or fewer."
    )


def _scene(number: int, rng: np.random.Generator) -> Scene:
    style: Style = str(rng.choice(["furnished", "glass", "bare"], p=[0.7, 0.15, 0.15]))  # type: ignore[assignment]
    size, storeys = ("full" if rng.random() < 0.25 else "small"), (2 if rng.random() < 0.1 else 1)
    config = BuildingConfig(seed=FIRST_SEED + number, size=size, storeys=storeys, style=style, people=False)  # type: ignore[arg-type]
    scene = make_scene(config)
    boxes = list(scene.boxes)
    for room in scene.plan.rooms:
        for rect in room.rects:
            boxes += _clutter(rect.expanded(-0.15), rng, 0 if style == "bare" else rng.uniform(0.0, 0.6))
            if style != "bare":
                boxes += _along_a_wall(rect.expanded(-0.05), rng) if rng.random() < 0.7 else ()
                boxes += _central_furniture(rect.expanded(-0.3), rng)
            boxes += _under_the_ceiling(rect, rng)
    boxes += [thing for top in _tops(boxes) if rng.random() < 0.6 for thing in _things_on(top, rng)]
    return dataclasses.replace(scene, boxes=tuple(boxes), solids=make_solids(scene.storeys, boxes))


_POLE, _TABLES, _SHELF, _CHAIR = 4, (2, 3), 5, 6
"""Kinds of clutter; all others are boxes on the floor."""


def _clutter(rect: Rect, rng: np.random.Generator, density: float) -> Iterator[Box]:
    """Boxes on the floor, tables, poles, hanging shelves, chairs: `density` controls their number per square meter."""
    if rect.x1 - rect.x0 < 0.8 or rect.y1 - rect.y0 < 0.8:
        return
    for _ in range(int(rng.poisson(rect.area * density * 0.6))):
        kind = int(rng.integers(7))
        w, d = rng.uniform(0.1, 1.3, 2)
        h = rng.uniform(1.2, 2.4) if kind == _SHELF else rng.uniform(0.05, 1.0)
        if kind == _POLE:
            w, d, h = rng.uniform(0.02, 0.12), rng.uniform(0.02, 0.12), rng.uniform(0.3, 2.5)
        w, d = min(w, 0.45 * (rect.x1 - rect.x0)), min(d, 0.45 * (rect.y1 - rect.y0))
        x, y = rng.uniform(rect.x0, rect.x1 - w), rng.uniform(rect.y0, rect.y1 - d)
        paint = Paint(
            str(rng.choice(["plain", "wood", "cloth", "carton", "drawers", "books", "stone"])), _random_color(rng)
        )

        if kind in _TABLES:
            h, t, leg = rng.uniform(0.3, 1.0), rng.uniform(0.02, 0.08), rng.uniform(0.02, 0.06)
            yield _box((x, y, h), (x + w, y + d, h + t), paint)
            for lx, ly in ((0, 0), (w - leg, 0), (0, d - leg), (w - leg, d - leg)):
                yield _box((x + lx, y + ly, 0), (x + lx + leg, y + ly + leg, h), paint)
        elif kind == _CHAIR:
            yield from _chair(x, y, paint, rng)
        elif kind == _SHELF:
            yield _box((x, y, h - rng.uniform(0.03, 0.5)), (x + w, y + d, min(h, HEIGHT - 0.05)), paint)
        else:
            yield _box((x, y, 0), (x + w, y + d, h), paint)


def _chair(x: float, y: float, paint: Paint, rng: np.random.Generator) -> Iterator[Box]:
    """A seat on legs or on a block, with a back on a random side."""
    w, seat = rng.uniform(0.38, 0.6), rng.uniform(0.35, 0.5)
    thick, back = rng.uniform(0.03, 0.15), rng.uniform(0.3, 0.6)
    leg, slim = rng.uniform(0.02, 0.05), rng.uniform(0.03, 0.12)
    yield _box((x, y, seat - thick), (x + w, y + w, seat), paint)
    near = float(rng.choice([0.0, w - slim]))
    lean = (near, 0.0, slim, w) if rng.random() < 0.5 else (0.0, near, w, slim)
    yield _box((x + lean[0], y + lean[1], seat), (x + lean[0] + lean[2], y + lean[1] + lean[3], seat + back), paint)
    dark = Paint("plain", (0.12, 0.12, 0.12)) if rng.random() < 0.5 else paint
    for lx in (0, w - leg):
        for ly in (0, w - leg):
            yield _box((x + lx, y + ly, 0), (x + lx + leg, y + ly + leg, seat - thick), dark)


def _along_a_wall(rect: Rect, rng: np.random.Generator) -> Iterator[Box]:
    """A row of cupboards with its top, a bench with its back, or a bed: broad, low surfaces that resemble a floor."""
    along, across = rect.x1 - rect.x0, rect.y1 - rect.y0
    turned = bool(rng.random() < 0.5)
    if turned:
        along, across = across, along
    length, kind = rng.uniform(0.4, 0.9) * along, int(rng.integers(3))
    least, most = (((0.4, 0.75), (0.7, 1.0)), ((0.6, 0.4), (1.0, 0.5)), ((0.9, 0.35), (1.8, 0.65)))[kind]
    depth, height = rng.uniform(least, most)
    if depth > 0.5 * across or length < 0.8:
        return
    begin, far = rng.uniform(0, along - length), bool(rng.random() < 0.5)

    def box(a: float, b: float, low: float, high: float, paint: Paint) -> Box:
        """A box from depth `a` to `b` from the wall, at heights `low` to `high`, in meters."""
        near, off = (across - b, across - a) if far else (a, b)
        x0, x1, y0, y1 = (near, off, begin, begin + length) if turned else (begin, begin + length, near, off)
        return _box((rect.x0 + x0, rect.y0 + y0, low), (rect.x0 + x1, rect.y0 + y1, high), paint)

    dull = rng.uniform(0.03, 0.15)
    tone = _random_color(rng) if rng.random() < 0.7 else (dull, dull, dull)
    front = Paint(str(rng.choice(("drawers", "wood", "plain") if kind == 0 else ("cloth", "plain"))), tone)
    yield box(0, depth, 0, height, front)
    if kind == 0:
        top = Paint(str(rng.choice(["wood", "stone", "plain"])), _random_color(rng))
        yield box(0, depth + rng.uniform(0, 0.04), height, height + 0.04, top)
        if rng.random() < 0.5:  # wall cupboards of a kitchen, and the panel below them
            low = height + rng.uniform(0.4, 0.6)
            yield box(0, 0.35, low, low + rng.uniform(0.4, 0.8), front)
            yield box(0, 0.01, height + 0.04, low, Paint("plain", _random_color(rng)))
    elif kind == 1:
        yield box(0, rng.uniform(0.12, 0.3), height, height + rng.uniform(0.3, 0.5), front)


def _central_furniture(rect: Rect, rng: np.random.Generator) -> Iterator[Box]:
    """A large table, a kitchen island, a bed with pillows, or nothing: surfaces that fill the view of a near camera."""
    kind = int(rng.integers(5))
    least, most = (((0.7, 1.2), (1.5, 2.8)), ((0.6, 1.0), (1.2, 2.6)), ((0.9, 1.8), (2.0, 2.2)))[min(kind, 2)]
    w, d = (rng.uniform(*sides) for sides in zip(least, most))
    if rng.random() < 0.5:
        w, d = d, w
    if kind > 2 or rect.x1 - rect.x0 < w + 0.8 or rect.y1 - rect.y0 < d + 0.8:
        return
    x, y = rng.uniform(rect.x0, rect.x1 - w), rng.uniform(rect.y0, rect.y1 - d)
    low, high = ((0.65, 1.1), (0.85, 1.0), (0.35, 0.7))[kind]
    h = rng.uniform(low, high)
    if kind == 0:
        t, leg, wood = rng.uniform(0.02, 0.07), rng.uniform(0.03, 0.09), Paint("wood", _random_color(rng))
        yield _box((x, y, h - t), (x + w, y + d, h), wood)
        for lx, ly in ((0, 0), (w - leg, 0), (0, d - leg), (w - leg, d - leg)):
            yield _box((x + lx, y + ly, 0), (x + lx + leg, y + ly + leg, h - t), wood)
    elif kind == 1:
        yield _box(
            (x, y, 0),
            (x + w, y + d, h - 0.04),
            Paint(str(rng.choice(["drawers", "wood", "plain"])), _random_color(rng)),
        )
        yield _box((x - 0.02, y - 0.02, h - 0.04), (x + w + 0.02, y + d + 0.02, h), Paint("stone", _random_color(rng)))
    else:
        cloth = Paint("cloth", _random_color(rng))
        yield _box((x, y, 0), (x + w, y + d, h), cloth)
        for k in range(int(rng.integers(1, 3))):
            yield _box(
                (x + 0.05 + 0.5 * k, y + 0.05, h),
                (x + 0.5 + 0.5 * k, y + 0.4, h + 0.15),
                Paint("cloth", _random_color(rng)),
            )


def _tops(boxes: list[Box]) -> list[Box]:
    """The boxes with a broad top at the height of seats, beds, tables and counters."""
    return [b for b in boxes if 0.3 < b.hi[2] < 1.15 and b.ground.area > 0.3 and not b.glass]


def _things_on(top: Box, rng: np.random.Generator) -> Iterator[Box]:
    """Books, boxes, dishes and sheets of paper on a surface."""
    ground, h = top.ground, top.hi[2]
    for _ in range(int(rng.integers(1, 9))):
        w, d = rng.uniform(0.05, 0.4, 2)
        if w > 0.8 * (ground.x1 - ground.x0) or d > 0.8 * (ground.y1 - ground.y0):
            continue
        x, y = rng.uniform(ground.x0, ground.x1 - w), rng.uniform(ground.y0, ground.y1 - d)
        tall = 0.003 if rng.random() < 0.25 else rng.uniform(0.02, 0.4)
        paint = Paint(str(rng.choice(["plain", "wood", "cloth", "carton", "books"])), _random_color(rng))
        yield _box((x, y, h), (x + w, y + d, h + tall), paint)


def _under_the_ceiling(rect: Rect, rng: np.random.Generator) -> Iterator[Box]:
    """Beams from wall to wall, a lowered part of the ceiling, or nothing."""
    if rng.random() < 0.55 or min(rect.x1 - rect.x0, rect.y1 - rect.y0) < 0.8:
        return
    turned = bool(rng.random() < 0.5)
    across = (rect.y1 - rect.y0) if turned else (rect.x1 - rect.x0)
    drop, pale = rng.uniform(0.08, 0.45), rng.uniform(0.3, 0.95)
    paint = Paint("plain", (pale, pale, pale)) if rng.random() < 0.7 else Paint("wood", _random_color(rng))
    if rng.random() < 0.6:  # beams
        width, step = rng.uniform(0.08, 0.4), rng.uniform(0.8, 3.0)
        spans = [(a, a + width) for a in np.arange(rng.uniform(0, step), across - width, step)]
    else:
        begin = rng.uniform(0, 0.6) * across
        spans = [(begin, min(across, begin + rng.uniform(0.4, 1.0) * across))]
    for a, b in spans:
        x0, x1, y0, y1 = (rect.x0, rect.x1, rect.y0 + a, rect.y0 + b) if turned else (
            rect.x0 + a, rect.x0 + b, rect.y0, rect.y1,
        )  # fmt: skip
        yield _box((x0, y0, HEIGHT - drop), (x1, y1, HEIGHT), paint)


def _box(low: tuple[float, float, float], high: tuple[float, float, float], paint: Paint) -> Box:
    x0, y0, z0, x1, y1, z1 = (round(v, 3) for v in (*low, *high))
    return Box((x0, y0, z0), (x1, y1, z1), paint)


def _random_color(rng: np.random.Generator) -> tuple[float, float, float]:
    r, g, b = color(rng)
    return float(r), float(g), float(b)


def _cameras(scene: Scene, rng: np.random.Generator, upright: bool, tries: int) -> Iterator[Camera]:
    """Cameras at free positions among `tries` random ones: level, tilted, looking down like those of the map builder,
    and held at furniture."""
    rows, columns = SIZE[::-1] if upright else SIZE
    tops = _tops(list(scene.boxes))
    for _ in range(tries):
        if tops and rng.random() < _AT_FURNITURE:
            pose, field = _at_furniture(tops[int(rng.integers(len(tops)))], rng), rng.uniform(40, 80)
            if not _inside(scene, pose[:3, 3]):
                yield Camera(
                    Intrinsics.from_fov(columns, rows, np.radians(field * columns / SIZE[1])), _roll_camera(pose, rng)
                )
            continue
        storey = scene.storeys[int(rng.integers(len(scene.storeys)))]
        room = storey.plan.rooms[int(rng.integers(len(storey.plan.rooms)))]
        rect = room.rects[int(rng.integers(len(room.rects)))].expanded(-0.3)
        position = np.array([
            rng.uniform(rect.x0, max(rect.x0, rect.x1)), rng.uniform(rect.y0, max(rect.y0, rect.y1)),
            storey.floor + rng.uniform(0.4, 1.9),
        ])  # fmt: skip
        if _inside(scene, position):
            continue
        way = rng.random()
        elevation = rng.normal(0, 8) if way < 0.45 else rng.uniform(-60, 15) if way < 0.75 else rng.normal(-45, 4)
        pose = _roll_camera(camera_pose(position, rng.uniform(0, 2 * np.pi), np.radians(elevation)), rng)
        yield Camera(Intrinsics.from_fov(columns, rows, np.radians(rng.uniform(45, 100) * columns / SIZE[1])), pose)


def _inside(scene: Scene, position: NDArray[np.float64]) -> bool:
    """Whether a position is within 15 cm of a box."""
    return bool(((position > scene.solids.lo - 0.15) & (position < scene.solids.hi + 0.15)).all(axis=1).any())


def _roll_camera(pose: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """The pose (4, 4), turned by a few degrees about the optical axis."""
    roll = np.radians(rng.normal(0, 4))
    pose[:3, :3] = pose[:3, :3] @ np.array(
        [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
    )
    return pose


def _at_furniture(top: Box, rng: np.random.Generator) -> NDArray[np.float64]:
    """The pose (4, 4) of a camera that a hand holds at a table, a counter or a bed, and that looks at its top. In half
    of the views the camera is so near that the top may fill the image."""
    ground = top.ground
    aim = np.array([rng.uniform(ground.x0, ground.x1), rng.uniform(ground.y0, ground.y1), top.hi[2]])
    heading, away = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 1.0) if rng.random() < 0.5 else rng.uniform(0.8, 2.5)
    position = aim - away * np.array([np.sin(heading), np.cos(heading), 0])
    position[2] += rng.uniform(0.15, 1.0)
    down = -np.degrees(np.arctan2(position[2] - aim[2], away))
    return camera_pose(position, heading + rng.normal(0, 0.15), np.radians(down + rng.normal(0, 8)))


def _crowd(scene: Scene, camera: Camera, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Capsules (P, 5) and colors (P, 3) of people, bins and columns in front of a camera."""
    level = max((s.floor for s in scene.storeys if s.floor < camera.position[2]), default=0.0)
    capsules, colors = [], []
    for _ in range(int(rng.integers(0, 4)) if rng.random() < 0.5 else 0):
        ahead = camera.rotation[:2, 2] / max(1e-6, float(np.linalg.norm(camera.rotation[:2, 2])))
        side = np.array([-ahead[1], ahead[0]])
        x, y = camera.position[:2] + ahead * rng.uniform(1.2, 5) + side * rng.uniform(-1.5, 1.5)
        if rng.random() < 0.5:  # a person
            for r, low, high in ((0.12, 0.12, 0.8), (rng.uniform(0.17, 0.24), 0.95, 1.35), (0.11, 1.55, 1.65)):
                capsules.append((x, y, level + low, level + high, r))
                colors.append(_random_color(rng))
        else:
            r = rng.uniform(0.05, 0.4)
            capsules.append((x, y, level, level + rng.uniform(0.1, 2.5), r))
            colors.append(_random_color(rng))
    if not capsules:
        return np.empty((0, 5)), np.empty((0, 3))
    return np.array(capsules), np.array(colors)


def _normals(scene: Scene, view: View, camera: Camera, people: NDArray[np.float64]) -> NDArray[np.float32]:
    """(H, W, 3) float32 unit normals as `truth.normals`, also on people."""
    found = normals(scene, view)
    which = view.surface - scene.first_person
    rows, columns = np.nonzero(which >= 0)
    if len(rows):
        rays = camera.rays()[rows, columns]
        along = view.depth[rows, columns] / (rays @ camera.rotation[:, 2])
        place = camera.position + along[:, None] * rays
        p = people[which[rows, columns]]
        axis = np.column_stack([p[:, 0], p[:, 1], np.clip(place[:, 2], p[:, 2], p[:, 3])])
        out = place - axis
        found[rows, columns] = out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-6)
    return found
