"""Generated kitchens: cupboards with plain fronts along one to three walls, worktops, tall units, and a table with
chairs."""

from __future__ import annotations

import colorsys
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from nvsim.building.plan import Rect
from nvsim.building.solids import Box, Color, Paint
from nvsim.recipes.furniture import painted_box, random_color, table

_DEEPEST = 0.72  # meters from the wall to the edge of a worktop


class _Look(NamedTuple):
    """Paints and sizes (meters) that all cupboards of a kitchen share."""

    front: Paint
    top: Paint
    plinth: Paint
    splash: Paint
    height: float
    depth: float
    foot: float
    slab: float


def kitchen(rect: Rect, rng: np.random.Generator) -> Iterator[Box]:
    """The furniture of a kitchen that fills `rect`, from its lower floor (z = 0)."""
    look = _look(rng)
    first, count = int(rng.integers(4)), int(rng.choice([1, 2, 3], p=[0.3, 0.5, 0.2]))
    for i in range(count):
        yield from _row(_Side(rect, (first + i) % 4), look, i > 0, rng)
    if rng.random() < 0.8:
        yield from _dining(rect.expanded(-_DEEPEST - 0.3), rng)


class _Side:
    """Boxes along one side of a rectangle: `a` meters along the side, `b` meters away from it."""

    def __init__(self, rect: Rect, number: int) -> None:
        self._rect, self._number = rect, number
        self.length = rect.x1 - rect.x0 if number % 2 == 0 else rect.y1 - rect.y0

    def box(self, a: tuple[float, float], b: tuple[float, float], z: tuple[float, float], paint: Paint) -> Box:
        r = self._rect
        x, y = {
            0: ((r.x0 + a[0], r.x0 + a[1]), (r.y0 + b[0], r.y0 + b[1])),
            1: ((r.x1 - b[1], r.x1 - b[0]), (r.y0 + a[0], r.y0 + a[1])),
            2: ((r.x1 - a[1], r.x1 - a[0]), (r.y1 - b[1], r.y1 - b[0])),
            3: ((r.x0 + b[0], r.x0 + b[1]), (r.y1 - a[1], r.y1 - a[0])),
        }[self._number]
        return painted_box((x[0], y[0], z[0]), (x[1], y[1], z[1]), paint)


def _look(rng: np.random.Generator) -> _Look:
    front, dark = _front_color(rng), rng.uniform(0.03, 0.2)
    top = (dark, dark, dark) if rng.random() < 0.4 else random_color(rng)
    tile = Paint(str(rng.choice(["stone", "plain", "drawers"])), random_color(rng))
    gray = rng.uniform(0.1, 0.7)
    plinth = Paint("plain", (gray, gray, gray)) if rng.random() < 0.6 else Paint("plain", front)
    handle = rng.uniform(0.05, 0.9)
    return _Look(
        front=Paint("front", front, (handle, handle, handle)),
        top=Paint(str(rng.choice(["stone", "plain", "wood"])), top),
        plinth=plinth,
        splash=tile,
        height=rng.uniform(0.82, 0.97),
        depth=rng.uniform(0.5, 0.66),
        foot=rng.uniform(0.06, 0.16),
        slab=rng.uniform(0.025, 0.06),
    )


def _front_color(rng: np.random.Generator) -> Color:
    """Saturated, nearly white or gray, or any."""
    kind = rng.random()
    if kind < 0.4:
        r, g, b = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.45, 1.0), rng.uniform(0.15, 0.85))
        return r, g, b
    if kind < 0.7:
        pale = rng.uniform(0.3, 0.92)
        return pale, pale, pale * rng.uniform(0.9, 1.0)
    return random_color(rng)


def _row(side: _Side, look: _Look, corner: bool, rng: np.random.Generator) -> Iterator[Box]:
    """Cupboards along a side; with `corner`, they begin at the corner where the row of the side before ends."""
    begin = 0.0 if corner else rng.uniform(0, 0.3) * side.length
    end = side.length if rng.random() < 0.5 else rng.uniform(begin + 0.5 * (side.length - begin), side.length)
    if end - begin < 1.0:
        return
    if rng.random() < 0.5:  # a fridge or an oven
        wide, tall = rng.uniform(0.55, 0.75), rng.uniform(1.5, 2.3)
        paint = Paint("front", _front_color(rng), look.front.accent) if rng.random() < 0.5 else look.front
        yield side.box((end - wide, end), (0, look.depth + rng.uniform(-0.05, 0.06)), (0, tall), paint)
        end -= wide
    z = look.height
    yield side.box((begin, end), (0, look.depth - 0.05), (0, look.foot), look.plinth)
    yield side.box((begin, end), (0, look.depth), (look.foot, z - look.slab), look.front)
    yield side.box((begin, end), (0, look.depth + rng.uniform(0, 0.04)), (z - look.slab, z), look.top)
    low = z + rng.uniform(0.4, 0.65)
    if rng.random() < 0.7:
        yield side.box((begin, end), (0, 0.012), (z, low), look.splash)
    if rng.random() < 0.6:
        yield side.box((begin, end), (0, rng.uniform(0.28, 0.38)), (low, low + rng.uniform(0.35, 0.8)), look.front)
    for _ in range(int(rng.integers(0, 5))):  # sheets of paper and small pictures on the wall
        at, wide, high = rng.uniform(begin, max(begin, end - 0.4)), rng.uniform(0.1, 0.4), rng.uniform(0.15, 0.4)
        up = rng.uniform(z + 0.1, 1.6)
        yield side.box((at, at + wide), (0, 0.02), (up, up + high), Paint("carton", random_color(rng)))


def _dining(rect: Rect, rng: np.random.Generator) -> Iterator[Box]:
    """A table with chairs at its sides."""
    w, d = rng.uniform(0.65, 1.0), rng.uniform(0.8, 1.8)
    if rng.random() < 0.5:
        w, d = d, w
    if rect.x1 - rect.x0 < w or rect.y1 - rect.y0 < d:
        return
    x, y = rng.uniform(rect.x0, rect.x1 - w), rng.uniform(rect.y0, rect.y1 - d)
    h, t, leg = rng.uniform(0.7, 0.78), rng.uniform(0.02, 0.06), rng.uniform(0.03, 0.1)
    wood = Paint(str(rng.choice(["wood", "plain"])), random_color(rng))
    place = Rect(x, y, x + w, y + d)
    yield from table(place, (h - t, h), leg, wood)
    paint = Paint(str(rng.choice(["wood", "plain", "cloth"])), random_color(rng)) if rng.random() < 0.6 else wood
    for side in range(4):
        length = w if side % 2 == 0 else d
        for k in range(max(1, int(length / 0.6))):
            if rng.random() < 0.6:
                at = (k + 0.5) * length / max(1, int(length / 0.6)) - 0.21
                yield from _slatted_chair(place, side, at, paint, rng)


def _slatted_chair(beside: Rect, side: int, at: float, paint: Paint, rng: np.random.Generator) -> Iterator[Box]:
    """A chair in front of a side of a table, `at` meters along it, with a back of slats or a closed one."""
    place = _Side(beside, side)
    size, seat, top = 0.42, rng.uniform(0.42, 0.48), rng.uniform(0.8, 1.0)
    away = rng.uniform(-0.25, 0.25) + size  # of the back from the edge of the table
    post = rng.uniform(0.025, 0.05)

    def box(a0: float, a1: float, b0: float, b1: float, z0: float, z1: float) -> Box:
        return place.box((at + a0, at + a1), (b0 - away, b1 - away), (z0, z1), paint)

    yield box(0, size, 0, size, seat - rng.uniform(0.03, 0.07), seat)
    for a in (0.0, size - post):
        yield box(a, a + post, size - post, size, 0, seat)
        yield box(a, a + post, 0, post, 0, top)
    if rng.random() < 0.7:
        slats = int(rng.integers(2, 6))
        for k in range(slats):
            z = seat + (k + 1) * (top - seat) / slats
            yield box(post, size - post, 0.005, post, z - 0.45 * (top - seat) / slats, z)
    else:
        yield box(post, size - post, 0.005, post, seat + rng.uniform(0, 0.2), top)
