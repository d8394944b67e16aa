"""Random furniture for generated interiors: boxes on the floor, tables, chairs, cupboards, beds, beams, and things on
tops. Kitchens are in `kitchens`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nvsim.building.plan import HEIGHT, Rect
from nvsim.building.solids import Box, Color, Paint
from nvsim.recipes.patterns import color

_POLE, _TABLES, _SHELF, _CHAIR = 4, (2, 3), 5, 6
"""Kinds of clutter; all others are boxes on the floor."""


def clutter(rect: Rect, rng: np.random.Generator, density: float) -> Iterator[Box]:
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
            str(rng.choice(["plain", "wood", "cloth", "carton", "drawers", "books", "stone"])), random_color(rng)
        )

        if kind in _TABLES:
            h, t, leg = rng.uniform(0.3, 1.0), rng.uniform(0.02, 0.08), rng.uniform(0.02, 0.06)
            yield from table(Rect(x, y, x + w, y + d), (h, h + t), leg, paint)
        elif kind == _CHAIR:
            yield from _chair(x, y, paint, rng)
        elif kind == _SHELF:
            yield painted_box((x, y, h - rng.uniform(0.03, 0.5)), (x + w, y + d, min(h, HEIGHT - 0.05)), paint)
        else:
            yield painted_box((x, y, 0), (x + w, y + d, h), paint)


def table(rect: Rect, top: tuple[float, float], leg: float, paint: Paint) -> Iterator[Box]:
    """A table top over `rect` between two heights, with a leg of width `leg` at each corner, in meters."""
    yield painted_box((rect.x0, rect.y0, top[0]), (rect.x1, rect.y1, top[1]), paint)
    for x, y in (
        (rect.x0, rect.y0),
        (rect.x1 - leg, rect.y0),
        (rect.x0, rect.y1 - leg),
        (rect.x1 - leg, rect.y1 - leg),
    ):
        yield painted_box((x, y, 0), (x + leg, y + leg, top[0]), paint)


def _chair(x: float, y: float, paint: Paint, rng: np.random.Generator) -> Iterator[Box]:
    """A seat on legs or on a block, with a back on a random side."""
    w, seat = rng.uniform(0.38, 0.6), rng.uniform(0.35, 0.5)
    thick, back = rng.uniform(0.03, 0.15), rng.uniform(0.3, 0.6)
    leg, slim = rng.uniform(0.02, 0.05), rng.uniform(0.03, 0.12)
    yield painted_box((x, y, seat - thick), (x + w, y + w, seat), paint)
    near = float(rng.choice([0.0, w - slim]))
    lean = (near, 0.0, slim, w) if rng.random() < 0.5 else (0.0, near, w, slim)
    yield painted_box(
        (x + lean[0], y + lean[1], seat), (x + lean[0] + lean[2], y + lean[1] + lean[3], seat + back), paint
    )
    dark = Paint("plain", (0.12, 0.12, 0.12)) if rng.random() < 0.5 else paint
    for lx in (0, w - leg):
        for ly in (0, w - leg):
            yield painted_box((x + lx, y + ly, 0), (x + lx + leg, y + ly + leg, seat - thick), dark)


def along_a_wall(rect: Rect, rng: np.random.Generator) -> Iterator[Box]:
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
        return painted_box((rect.x0 + x0, rect.y0 + y0, low), (rect.x0 + x1, rect.y0 + y1, high), paint)

    dull = rng.uniform(0.03, 0.15)
    tone = random_color(rng) if rng.random() < 0.7 else (dull, dull, dull)
    front = Paint(str(rng.choice(("drawers", "wood", "plain") if kind == 0 else ("cloth", "plain"))), tone)
    yield box(0, depth, 0, height, front)
    if kind == 0:
        top = Paint(str(rng.choice(["wood", "stone", "plain"])), random_color(rng))
        yield box(0, depth + rng.uniform(0, 0.04), height, height + 0.04, top)
        if rng.random() < 0.5:  # wall cupboards of a kitchen, and the panel below them
            low = height + rng.uniform(0.4, 0.6)
            yield box(0, 0.35, low, low + rng.uniform(0.4, 0.8), front)
            yield box(0, 0.01, height + 0.04, low, Paint("plain", random_color(rng)))
    elif kind == 1:
        yield box(0, rng.uniform(0.12, 0.3), height, height + rng.uniform(0.3, 0.5), front)


def central_furniture(rect: Rect, rng: np.random.Generator) -> Iterator[Box]:
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
        t, leg, wood = rng.uniform(0.02, 0.07), rng.uniform(0.03, 0.09), Paint("wood", random_color(rng))
        yield from table(Rect(x, y, x + w, y + d), (h - t, h), leg, wood)
    elif kind == 1:
        yield painted_box(
            (x, y, 0),
            (x + w, y + d, h - 0.04),
            Paint(str(rng.choice(["drawers", "wood", "plain"])), random_color(rng)),
        )
        yield painted_box(
            (x - 0.02, y - 0.02, h - 0.04), (x + w + 0.02, y + d + 0.02, h), Paint("stone", random_color(rng))
        )
    else:
        cloth = Paint("cloth", random_color(rng))
        yield painted_box((x, y, 0), (x + w, y + d, h), cloth)
        for k in range(int(rng.integers(1, 3))):
            yield painted_box(
                (x + 0.05 + 0.5 * k, y + 0.05, h),
                (x + 0.5 + 0.5 * k, y + 0.4, h + 0.15),
                Paint("cloth", random_color(rng)),
            )


def things_on(top: Box, rng: np.random.Generator) -> Iterator[Box]:
    """Books, boxes, dishes and sheets of paper on a surface."""
    ground, h = top.ground, top.hi[2]
    for _ in range(int(rng.integers(1, 9))):
        w, d = rng.uniform(0.05, 0.4, 2)
        if w > 0.8 * (ground.x1 - ground.x0) or d > 0.8 * (ground.y1 - ground.y0):
            continue
        x, y = rng.uniform(ground.x0, ground.x1 - w), rng.uniform(ground.y0, ground.y1 - d)
        tall = 0.003 if rng.random() < 0.25 else rng.uniform(0.02, 0.4)
        paint = Paint(str(rng.choice(["plain", "wood", "cloth", "carton", "books"])), random_color(rng))
        yield painted_box((x, y, h), (x + w, y + d, h + tall), paint)


def under_the_ceiling(rect: Rect, rng: np.random.Generator) -> Iterator[Box]:
    """Beams from wall to wall, a lowered part of the ceiling, or nothing."""
    if rng.random() < 0.55 or min(rect.x1 - rect.x0, rect.y1 - rect.y0) < 0.8:
        return
    turned = bool(rng.random() < 0.5)
    across = (rect.y1 - rect.y0) if turned else (rect.x1 - rect.x0)
    drop, pale = rng.uniform(0.08, 0.45), rng.uniform(0.3, 0.95)
    paint = Paint("plain", (pale, pale, pale)) if rng.random() < 0.7 else Paint("wood", random_color(rng))
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
        yield painted_box((x0, y0, HEIGHT - drop), (x1, y1, HEIGHT), paint)


def painted_box(low: tuple[float, float, float], high: tuple[float, float, float], paint: Paint) -> Box:
    """A box from corner `low` to corner `high`, rounded to millimeters."""
    x0, y0, z0, x1, y1, z1 = (round(v, 3) for v in (*low, *high))
    return Box((x0, y0, z0), (x1, y1, z1), paint)


def random_color(rng: np.random.Generator) -> Color:
    """A color of `patterns.color`."""
    r, g, b = color(rng)
    return float(r), float(g), float(b)
