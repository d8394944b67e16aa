"""Albedo of walls and furniture: paints the face of a box by its kind of paint, with detail of 3 cm and more.

Images in this module are (rows, columns, 3) float32, 0 to 1; row 0 is the lower edge of the face (or its lowest y).
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.building.solids import Color, Paint

Image = NDArray[np.float32]


def blotches(rows: int, columns: int, grain: tuple[float, float], rng: np.random.Generator) -> Image:
    """(rows, columns) smooth noise of mean 0 and deviation about 1; `grain` is the size of a blotch in texels (y,
    x)."""
    coarse = rng.standard_normal((int(rows / grain[0]) + 3, int(columns / grain[1]) + 3)).astype(np.float32)
    size = (int(coarse.shape[1] * grain[1]) + 1, int(coarse.shape[0] * grain[0]) + 1)
    fine = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    r, c = int(grain[0]), int(grain[1])
    cut: Image = fine[r : r + rows, c : c + columns] * np.float32(1.35)
    return cut


def _filled(rows: int, columns: int, color: Color) -> Image:
    return np.broadcast_to(np.array(color, np.float32), (rows, columns, 3)).copy()


def _plain(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    return _filled(rows, columns, paint.color)


def _wood(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    along = (0.04, 0.6) if columns >= rows else (0.6, 0.04)
    grain = blotches(rows, columns, (max(along[0] / texel, 1.5), max(along[1] / texel, 1.5)), rng)
    return _filled(rows, columns, paint.color) * (1 + 0.07 * grain[..., None])


def _cloth(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    return _filled(rows, columns, paint.color) * (
        1 + 0.035 * blotches(rows, columns, (0.08 / texel,) * 2, rng)[..., None]
    )


def _leaves(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    return _filled(rows, columns, paint.color) * (
        1 + 0.16 * blotches(rows, columns, (0.09 / texel,) * 2, rng)[..., None]
    )


def _stone(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    return _filled(rows, columns, paint.color) * (
        1 + 0.10 * blotches(rows, columns, (0.06 / texel,) * 2, rng)[..., None]
    )


def _carton(rows: int, columns: int, texel: float, paint: Paint, rng: np.random.Generator) -> Image:
    image = _filled(rows, columns, paint.color)
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
    image = _filled(rows, columns, (0.08, 0.08, 0.09))
    w, h = columns * texel, rows * texel
    _rectangle(image, texel, 0.03, 0.03, w - 0.06, h - 0.06, paint.color)
    _rectangle(image, texel, 0.06, h * 0.45, w * 0.4, h * 0.35, paint.accent)
    return image


def _muted(rng: np.random.Generator, tone: float) -> NDArray[np.float64]:
    return np.asarray(tone + rng.uniform(-0.12, 0.12, 3))


def _picture(image: Image, texel: float, x: float, y: float, w: float, h: float, rng: np.random.Generator) -> None:
    """Draws a framed print: a sky over a ground, with a sun and a few hills."""
    _rectangle(image, texel, x - 0.04, y - 0.04, w + 0.08, h + 0.08, (0.2, 0.17, 0.14))
    rows, columns = max(2, round(h / texel)), max(2, round(w / texel))
    v, u = np.mgrid[0:rows, 0:columns] / np.array([rows, columns]).reshape(2, 1, 1)
    sky, ground = _muted(rng, 0.72), _muted(rng, 0.4)
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
    image = _filled(rows, columns, paint.color)
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
    "plain": _plain,
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
