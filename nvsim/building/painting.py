"""Albedo of walls, furniture and floors with detail of 3 cm and more, by their kind of paint.

Images in this module are (rows, columns, 3) float32, 0 to 1; row 0 is the lower edge of the face (or its lowest y).
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.building.plan import Plan, Rect, Room
from nvsim.building.solids import Color, Paint

Image = NDArray[np.float32]


def smooth_noise(rows: int, columns: int, grain: tuple[float, float], rng: np.random.Generator) -> Image:
    """(rows, columns) smooth noise of mean 0 and deviation about 1; `grain` is the size of a blotch in texels (y,
    x)."""
    coarse = rng.standard_normal((int(rows / grain[0]) + 3, int(columns / grain[1]) + 3)).astype(np.float32)
    size = (int(coarse.shape[1] * grain[1]) + 1, int(coarse.shape[0] * grain[0]) + 1)
    fine = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    r, c = int(grain[0]), int(grain[1])
    cut: Image = fine[r : r + rows, c : c + columns] * np.float32(1.35)
    return cut


def _fill_image(rows: int, columns: int, color: Color) -> Image:
    return np.broadcast_to(np.array(color, np.float32), (rows, columns, 3)).copy()


def _paint_plain(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    return _fill_image(rows, columns, paint.color)


def _wood(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    along = (0.04, 0.6) if columns >= rows else (0.6, 0.04)
    grain = smooth_noise(rows, columns, (max(along[0] / texel, 1.5), max(along[1] / texel, 1.5)), rng)
    return _fill_image(rows, columns, paint.color) * (1 + 0.07 * grain[..., None])


def _cloth(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    return _fill_image(rows, columns, paint.color) * (
        1 + 0.035 * smooth_noise(rows, columns, (0.08 / texel,) * 2, rng)[..., None]
    )


def _leaves(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    return _fill_image(rows, columns, paint.color) * (
        1 + 0.16 * smooth_noise(rows, columns, (0.09 / texel,) * 2, rng)[..., None]
    )


def _stone(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    return _fill_image(rows, columns, paint.color) * (
        1 + 0.10 * smooth_noise(rows, columns, (0.06 / texel,) * 2, rng)[..., None]
    )


def _carton(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    image = _fill_image(rows, columns, paint.color)
    middle, half = columns // 2, max(1, round(0.03 / texel))
    image[:, max(0, middle - half) : middle + half] *= 0.8
    return image


def _rectangle(image: Image, texel: float, x: float, y: float, w: float, h: float, color: Color | Image) -> None:
    c0, r0 = max(round(x / texel), 0), max(round(y / texel), 0)
    c1, r1 = max(round((x + w) / texel), 0), max(round((y + h) / texel), 0)
    image[r0:r1, c0:c1] = np.asarray(color, np.float32)


def _drawers(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    image = _wood(rows, columns, texel, paint, rng)
    w, h = columns * texel, rows * texel
    across, up = max(1, round(w / 0.5)), max(1, round(h / 0.35))
    for i in range(across):
        for j in range(up):
            x, y = i * w / across, j * h / up
            tone = 1 + rng.uniform(-0.06, 0.06)
            c = tuple(float(np.clip(v * tone, 0, 1)) for v in paint.color)
            _rectangle(image, texel, x, y, w / across, 0.03, tuple(v * 0.6 for v in paint.color))  # type: ignore[arg-type]
            _rectangle(image, texel, x, y, 0.03, h / up, tuple(v * 0.6 for v in paint.color))  # type: ignore[arg-type]
            _rectangle(image, texel, x + 0.03, y + 0.03, w / across - 0.03, h / up - 0.03, c)  # type: ignore[arg-type]
            _rectangle(image, texel, x + w / across / 2 - 0.06, y + h / up * 0.75, 0.14, 0.035, (0.25, 0.25, 0.26))
    return image


def _books(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    image = _wood(rows, columns, texel, Paint("wood", paint.color), rng)
    w, h = columns * texel, rows * texel
    levels = max(1, round(h / 0.36))
    for level in range(levels):
        x, y = 0.04, level * h / levels + 0.04
        tall = h / levels - 0.05
        _rectangle(image, texel, x, y, w - 0.08, tall, (0.13, 0.11, 0.10))
        while x < w - 0.12:
            thick = float(rng.uniform(0.045, 0.10))
            if rng.random() < 0.88:
                tone = rng.uniform(0.2, 0.62)
                tint = tone + rng.uniform(-0.13, 0.13, 3)
                book = (float(tint[0]), float(tint[1]), float(tint[2]))
                _rectangle(image, texel, x, y, min(thick, w - 0.04 - x), tall * float(rng.uniform(0.68, 0.95)), book)
            x += thick
    return image


def _desk_top(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    """A wooden top with sheets of paper, a pad, and a book on it."""
    image = _wood(rows, columns, texel, paint, rng)
    w, h = columns * texel, rows * texel
    for _ in range(4):
        x, y = float(rng.uniform(0, max(w - 0.3, 0.01))), float(rng.uniform(0, max(h - 0.3, 0.01)))
        sheet = (0.85, 0.85, 0.82) if rng.random() < 0.6 else paint.accent
        size = (0.21, 0.30) if rng.random() < 0.5 else (0.30, 0.21)
        _rectangle(image, texel, x, y, size[0], size[1], sheet)
    return image


def _screen(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    image = _fill_image(rows, columns, (0.08, 0.08, 0.09))
    w, h = columns * texel, rows * texel
    _rectangle(image, texel, 0.03, 0.03, w - 0.06, h - 0.06, paint.color)
    _rectangle(image, texel, 0.06, h * 0.45, w * 0.4, h * 0.35, paint.accent)
    return image


def _random_tone(rng: np.random.Generator, tone: float) -> NDArray[np.float64]:
    return np.asarray(tone + rng.uniform(-0.12, 0.12, 3))


def _picture(image: Image, texel: float, x: float, y: float, w: float, h: float, rng: np.random.Generator) -> None:
    """Draws a framed print: a sky over a ground, with a sun and a few hills."""
    _rectangle(image, texel, x - 0.04, y - 0.04, w + 0.08, h + 0.08, (0.2, 0.17, 0.14))
    rows, columns = max(2, round(h / texel)), max(2, round(w / texel))
    v, u = np.mgrid[0:rows, 0:columns] / np.array([rows, columns]).reshape(2, 1, 1)
    sky, ground = _random_tone(rng, 0.72), _random_tone(rng, 0.4)
    print_ = sky * (1 - 0.25 * v[..., None]) + 0 * u[..., None]
    for k in range(3):
        phase, high = rng.uniform(0, 6.28), 0.55 - 0.15 * k
        hill = v < high + 0.08 * np.sin(phase + u * rng.uniform(3, 7))
        print_[hill] = ground * (1 - 0.25 * k) + 0.05 * k
    sun = (u - rng.uniform(0.2, 0.8)) ** 2 * (w / h) ** 2 + (v - 0.8) ** 2 < 0.008
    print_[sun] = (0.9, 0.8, 0.5)
    c, r = round(x / texel), round(y / texel)
    target = image[r : r + rows, c : c + columns]
    target[...] = print_[: target.shape[0], : target.shape[1]]


def _wall(
    rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator, at: tuple[float, float]
) -> Image:
    """Painted plaster: plain, striped, or paneled, with a skirting board. All kinds except "wall-bare" have pictures. A
    "wall-shaft", beside stairs, has only stripes."""
    image = _fill_image(rows, columns, paint.color)
    w, h = columns * texel, rows * texel
    u, v = at[0] + (np.arange(columns) + 0.5) * texel, at[1] + (np.arange(rows) + 0.5) * texel
    if paint.kind in ("wall-stripes", "wall-shaft"):
        image[:, np.floor(u / 0.3).astype(int) % 2 == 1] = paint.accent
    elif paint.kind == "wall-panel":
        image[v < 1.0] = paint.accent
        image[(v > 0.98) & (v < 1.06)] = (0.85, 0.84, 0.8)
    elif paint.kind == "wall-band":
        image[(v > 1.5) & (v < 1.8)] = paint.accent
    if paint.kind == "wall-shaft":
        return image
    if paint.kind != "wall-bare" and h > 2.5:
        x = float(rng.uniform(0.25, 0.7))
        while x < w - 0.7:
            pw, ph = float(rng.uniform(0.45, 0.95)), float(rng.uniform(0.45, 0.8))
            if x + pw < w - 0.15 and rng.random() < 0.75:
                _picture(image, texel, x, float(rng.uniform(1.25, 1.45)), pw, ph, rng)
            x += pw + float(rng.uniform(0.4, 1.2))
    image[v < 0.09] = (0.42, 0.36, 0.30)
    return image


_PAINTERS: dict[str, Callable[[int, int, float, Paint, np.random.Generator], Image]] = {
    "plain": _paint_plain,
    "wood": _wood,
    "cloth": _cloth,
    "leaves": _leaves,
    "stone": _stone,
    "carton": _carton,
    "drawers": _drawers,
    "books": _books,
    "desk": _desk_top,
    "screen": _screen,
}


def paint_face(
    paint: Paint, at: tuple[float, float], width: float, height: float, texel: float, rng: np.random.Generator
) -> Image:
    """The albedo (rows, columns, 3) of a face of `width` x `height` meters at about `texel` meters per texel, at least
    2 x 2 texels. `at` is its lower corner in the world, so that patterns continue over the pieces of a wall."""
    rows, columns = max(2, round(height / texel)), max(2, round(width / texel))
    if paint.kind.startswith("wall"):
        return _wall(rows, columns, texel, paint, rng, at)
    return _PAINTERS[paint.kind](rows, columns, texel, paint, rng)


_TONES = np.array([-0.15, 0.02, 0.15, -0.07, 0.10], np.float32)  # in this order neighbors differ clearly


def paint_floor(plan: Plan, texel: float, rng: np.random.Generator) -> tuple[Image, NDArray[np.float32]]:
    """Albedo (rows, columns, 3) with row 0 at y = 0, and gloss (rows, columns) from 0 to 1; `texel` meters per
    texel."""
    rows, columns = round(plan.extent.y1 / texel), round(plan.extent.x1 / texel)
    image = np.full((rows, columns, 3), 0.5, np.float32)
    gloss = np.zeros((rows, columns), np.float32)
    for room in plan.rooms:
        size, plank = float(rng.choice([0.3, 0.36, 0.4])), 0.12
        tile_color = np.clip(np.array([0.52, 0.50, 0.47]) + rng.uniform(-0.03, 0.03, 3), 0, 1)
        wood_color = np.array([0.56, 0.42, 0.29]) * rng.uniform(0.85, 1.15)
        for rect in room.rects:
            r0, r1, c0, c1 = (round(v / texel) for v in (rect.y0, rect.y1, rect.x0, rect.x1))
            if room.floor == "tiles":
                patch, shine = _tiles(r0, r1, c0, c1, texel, size, tile_color, rng), 1.0
            else:
                patch, shine = _paint_planks(r0, r1, c0, c1, texel, plank, wood_color, rng), 0.6
            image[r0:r1, c0:c1] = patch
            gloss[r0:r1, c0:c1] = shine
        if room.kind in ("lounge", "meeting", "hall"):
            rug = _rug_place(room, rng)
            r0, r1, c0, c1 = (round(v / texel) for v in (rug.y0, rug.y1, rug.x0, rug.x1))
            image[r0:r1, c0:c1] = _rug(r1 - r0, c1 - c0, texel, rng)
            gloss[r0:r1, c0:c1] = 0.0
    return np.clip(image, 0.03, 0.95), gloss


def _tiles(
    r0: int, r1: int, c0: int, c1: int, texel: float, size: float, color: NDArray[np.float64], rng: np.random.Generator
) -> Image:
    """Square tiles on a raster of the whole building (so that corridors match), each with its own tone and veins."""
    y, x = (np.arange(r0, r1) + 0.5) * texel, (np.arange(c0, c1) + 0.5) * texel
    j, i = np.floor(y / size).astype(int), np.floor(x / size).astype(int)
    key = (i[None, :] * 3 + j[:, None] * 2) % 5
    noise = np.random.Generator(np.random.PCG64(int(rng.integers(1 << 30)))).normal(0, 0.03, (64, 64))
    tone = _TONES[key] + noise[j[:, None] % 64, i[None, :] % 64]
    shape = (r1 - r0, c1 - c0)
    tone = tone + 0.06 * smooth_noise(*shape, (0.07 / texel, 0.07 / texel), rng)
    grout = (np.mod(y, size) < 0.018)[:, None] | (np.mod(x, size) < 0.018)[None, :]
    tone = np.where(grout, -0.24, tone)
    return (color + tone[..., None]).astype(np.float32)


def _paint_planks(
    r0: int, r1: int, c0: int, c1: int, texel: float, width: float, color: NDArray[np.float64], rng: np.random.Generator
) -> Image:
    """Staggered planks along x or y, each with its own tone, with grain along them."""
    turned = bool(rng.integers(2))
    rows, columns = (c1 - c0, r1 - r0) if turned else (r1 - r0, c1 - c0)
    y, x = (np.arange(rows) + 0.5) * texel, (np.arange(columns) + 0.5) * texel
    lane = np.floor(y / width).astype(int)
    offset = rng.uniform(0, 1.2, lane.max() + 1)
    along = (x[None, :] + offset[lane][:, None]) / 1.2
    index = np.floor(along).astype(int)
    tone = (
        _TONES[(lane[:, None] * 2 + index) % 5] * 0.85
        + rng.normal(0, 0.03, (lane.max() + 1, index.max() + 1))[np.broadcast_to(lane[:, None], index.shape), index]
    )
    tone = tone + 0.06 * smooth_noise(rows, columns, (0.035 / texel, 0.5 / texel), rng)
    seam = (np.mod(y, width) < 0.012)[:, None] | (np.mod(along, 1.0) < 0.01)
    tone = np.where(seam, tone - 0.12, tone)
    image = (color * (1 + 2.2 * tone[..., None])).astype(np.float32)
    return image.transpose(1, 0, 2) if turned else image


def _rug_place(room: Room, rng: np.random.Generator) -> Rect:
    area = room.rects[0]
    x, y = area.center
    w = min(float(rng.uniform(2.2, 3.0)), area.x1 - area.x0 - 1.6)
    d = min(float(rng.uniform(1.7, 2.4)), area.y1 - area.y0 - 1.2)
    x0, y0 = round(x - w / 2, 2), round(y - d / 2, 2)
    return Rect(x0, y0, round(x0 + w, 2), round(y0 + d, 2))


def _rug(rows: int, columns: int, texel: float, rng: np.random.Generator) -> Image:
    """A pattern of diamonds within a border, in three colors."""
    y, x = (np.arange(rows) + 0.5)[:, None] * texel, (np.arange(columns) + 0.5)[None, :] * texel
    dark, light, warm = rng.uniform(0.16, 0.28, 3), rng.uniform(0.55, 0.68, 3), np.array([0.50, 0.28, 0.24])
    warm = np.roll(warm, int(rng.integers(3)))
    diamond = np.abs(np.mod(x / 0.28, 1) - 0.5) + np.abs(np.mod(y / 0.28, 1) - 0.5)
    image = np.where((diamond < 0.24)[..., None], light, np.where((diamond < 0.5)[..., None], warm, dark))
    edge = np.minimum(np.minimum(x, columns * texel - x), np.minimum(y, rows * texel - y))
    stripe = np.floor((x + y) / 0.12).astype(int) % 2 == 0
    image = np.where(((edge < 0.2) & stripe)[..., None], light, np.where((edge < 0.2)[..., None], dark, image))
    return (image * (1 + 0.05 * smooth_noise(rows, columns, (0.05 / texel, 0.05 / texel), rng)[..., None])).astype(
        np.float32
    )
