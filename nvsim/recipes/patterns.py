"""Random patterns of surfaces (carpet, planks, tiles, stone, plain paint) in any color, for floors and other
surfaces."""

from __future__ import annotations

import colorsys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nvsim.building.painting import Image, paint_face, smooth_noise
from nvsim.building.plan import Plan, Rect
from nvsim.building.solids import Paint

Rng = np.random.Generator
Tone = NDArray[np.floating]


def color(rng: Rng) -> Tone:
    """(3,) RGB, 0 to 1. More than half of the colors are close to wood and sand; many are nearly gray."""
    hue = rng.uniform(0.04, 0.15) if rng.random() < 0.55 else rng.random()
    return np.array(colorsys.hsv_to_rgb(hue, rng.beta(1.2, 4.0), rng.uniform(0.12, 0.95)))


def pattern(rows: int, columns: int, texel: float, rng: Rng) -> Image:
    """(rows, columns, 3) float32, 0 to 1, with a random pattern; `texel` is the size of a texel in meters."""
    make = _KINDS[int(rng.integers(len(_KINDS)))]
    image = np.asarray(make(rows, columns, texel, rng), np.float32)
    return np.clip(image, 0.03, 0.97)


def paint_floor(plan: Plan, texel: float, rng: Rng) -> tuple[Image, NDArray[np.float32]]:
    """Like `nvsim.building.painting.paint_floor`: one pattern per storey or room, with rugs, stains and patches of
    light. Returns color (rows, columns, 3) float32, 0 to 1, and gloss (rows, columns); `texel` is in meters."""
    rows, columns = round(plan.extent.y1 / texel), round(plan.extent.x1 / texel)
    image = pattern(rows, columns, texel, rng)
    gloss = np.full((rows, columns), max(0.0, rng.uniform(-0.7, 1.2)), np.float32)
    if rng.random() < 0.6:
        for room in plan.rooms:
            shine = max(0.0, rng.uniform(-0.7, 1.2))
            seed = int(rng.integers(1 << 30))
            for rect in room.rects:
                r0, r1, c0, c1 = _texels(rect, texel)
                own = np.random.default_rng(seed)  # one pattern in all parts of a room
                image[r0:r1, c0:c1] = pattern(r1 - r0, c1 - c0, texel, own)
                gloss[r0:r1, c0:c1] = shine
    for _ in range(int(rng.integers(0, 2 + len(plan.rooms)))):
        (r0, c0), patch = _patch(rows, columns, texel, rng, 0.6, 3.0)
        within = image[r0 : r0 + patch.shape[0], c0 : c0 + patch.shape[1]]
        within[patch] = pattern(patch.shape[0], patch.shape[1], texel, rng)[patch]
        gloss[r0 : r0 + patch.shape[0], c0 : c0 + patch.shape[1]][patch] = 0
    for _ in range(int(rng.integers(0, 2 * len(plan.rooms)))):  # sunlight and shadows
        (r0, c0), patch = _patch(rows, columns, texel, rng, 0.3, 2.0)
        image[r0 : r0 + patch.shape[0], c0 : c0 + patch.shape[1]][patch] *= np.float32(rng.uniform(0.5, 1.9))
    return np.clip(image, 0.02, 0.97), gloss


def paint_ceiling(plan: Plan, texel: float, rng: Rng) -> Image:
    """Like `nvsim.building.baking.white_ceiling`, with a random brightness or pattern, in some storeys different in
    each room. Returns (rows, columns, 3) float32, 0 to 1; `texel` is in meters."""
    rows, columns = round(plan.extent.y1 / texel), round(plan.extent.x1 / texel)
    image = _overhead(rows, columns, texel, rng)
    for room in plan.rooms if rng.random() < 0.4 else ():
        for rect in room.rects:
            r0, r1, c0, c1 = _texels(rect, texel)
            image[r0:r1, c0:c1] = _overhead(r1 - r0, c1 - c0, texel, rng)
    return np.clip(image, 0.03, 0.97)


def _overhead(rows: int, columns: int, texel: float, rng: Rng) -> Image:
    if rng.random() < 0.2:
        return pattern(rows, columns, texel, rng)
    tone = rng.uniform(0.25, 0.9) * (1 + rng.normal(0, 0.02, 3))
    return _flat(rows, columns, tone)


def paint_anew(paint: Paint, at: tuple[float, float], width: float, height: float, texel: float, rng: Rng) -> Image:
    """Like `nvsim.building.painting.paint_face`, in other colors or with a random pattern. Returns (rows, columns, 3)
    float32, 0 to 1; `width`, `height` and `texel` are in meters."""
    if rng.random() < (0.85 if paint.kind == "front" else 0.5):
        image = _face(paint, at, width, height, texel, rng)
        if rng.random() < 0.7 and paint.kind != "front":
            image = image * (color(rng) / max(0.1, float(image.mean()))).astype(np.float32)
        return np.clip(image, 0.02, 0.97).astype(np.float32)
    rows, columns = max(2, round(height / texel)), max(2, round(width / texel))
    return pattern(rows, columns, texel, rng)


def _face(paint: Paint, at: tuple[float, float], width: float, height: float, texel: float, rng: Rng) -> Image:
    """Like `nvsim.building.painting.paint_face`, also for the kind "front": plain doors with narrow joints and
    handles in the accent color."""
    if paint.kind != "front":
        return paint_face(paint, at, width, height, texel, rng)
    rows, columns = max(2, round(height / texel)), max(2, round(width / texel))
    soft = _noise_pattern(rows, columns, 0.8, texel, rng)
    image = _flat(rows, columns, np.array(paint.color)) * (1 + rng.uniform(0, 0.03) * soft[..., None])
    style = np.random.default_rng(int(1e6 * sum(paint.color)) % (1 << 30))  # alike on all fronts of a kitchen
    door, joint = style.uniform(0.35, 0.9), style.uniform(0.3, 1.0)
    drawers, handles = style.random() < 0.3, style.random() < 0.75
    doors, levels = max(1, round(width / door)), (int(style.integers(2, 5)) if drawers else 1)
    for j in range(levels):
        for i in range(doors):
            r0, r1 = round(j * rows / levels), round((j + 1) * rows / levels)
            c0, c1 = round(i * columns / doors), round((i + 1) * columns / doors)
            image[r0:r1, c0 : c0 + 1] *= joint
            image[r0 : r0 + 1, c0:c1] *= joint
            if handles and c1 - c0 > 12 and r1 - r0 > 8:
                long, down = max(2, round(style.choice([0.05, 0.12, 0.25]) / texel)), round(0.06 / texel)
                middle = (c0 + c1) // 2
                image[r1 - down - 1 : r1 - down, max(c0, middle - long // 2) : middle + long // 2] = paint.accent
    return np.asarray(image, np.float32)


def paint_pale(paint: Paint, at: tuple[float, float], width: float, height: float, texel: float, rng: Rng) -> Image:
    """Like `nvsim.building.painting.paint_face`, nearly white or gray like walls and cupboards of many homes, so that
    mainly light and edges are visible. Returns (rows, columns, 3) float32, 0 to 1; sizes are in meters."""
    image = _face(paint, at, width, height, texel, rng)
    gray = image.mean(axis=2, keepdims=True)
    calm = gray.mean() + rng.uniform(0.1, 0.6) * (gray - gray.mean()) + rng.uniform(0, 0.3) * (image - gray)
    return np.clip(calm * (rng.uniform(0.4, 0.9) / max(0.1, float(gray.mean()))), 0.02, 0.97).astype(np.float32)


def _texels(rect: Rect, texel: float) -> tuple[int, int, int, int]:
    r0, r1, c0, c1 = (round(v / texel) for v in (rect.y0, rect.y1, rect.x0, rect.x1))
    return r0, r1, c0, c1


def _patch(
    rows: int, columns: int, texel: float, rng: Rng, least: float, most: float
) -> tuple[tuple[int, int], NDArray[np.bool_]]:
    """Start (row, column) of a patch and its shape (h, w) bool: a rectangle, an ellipse or a slanted strip; sides are
    in meters."""
    h, w = (min(n - 1, max(2, round(rng.uniform(least, most) / texel))) for n in (rows, columns))
    r0, c0 = int(rng.integers(0, rows - h)), int(rng.integers(0, columns - w))
    y, x = np.linspace(-1, 1, h)[:, None], np.linspace(-1, 1, w)[None, :]
    shape = rng.integers(3)
    if shape == 0:
        return (r0, c0), np.ones((h, w), bool)
    if shape == 1:
        return (r0, c0), x * x + y * y < 1
    return (r0, c0), np.abs(x + rng.uniform(-1, 1) * y) < rng.uniform(0.2, 0.6)


def _flat(rows: int, columns: int, tone: Tone) -> Image:
    return np.broadcast_to(np.asarray(tone, np.float32), (rows, columns, 3)).copy()


def _noise_pattern(rows: int, columns: int, meters: float, texel: float, rng: Rng) -> Image:
    return smooth_noise(rows, columns, (max(meters / texel, 1.0),) * 2, rng)


def _plain_pattern(rows: int, columns: int, texel: float, rng: Rng) -> Image:
    soft = _noise_pattern(rows, columns, rng.uniform(0.3, 1.5), texel, rng)
    return _flat(rows, columns, color(rng)) * (1 + rng.uniform(0, 0.05) * soft[..., None])


def _carpet(rows: int, columns: int, texel: float, rng: Rng) -> Image:
    fine = rng.standard_normal((rows, columns)).astype(np.float32) * rng.uniform(0.02, 0.12)
    coarse = sum(_noise_pattern(rows, columns, rng.uniform(*s), texel, rng) for s in ((0.02, 0.06), (0.1, 0.8)))
    image = _flat(rows, columns, color(rng)) * (1 + (fine + rng.uniform(0, 0.06) * np.asarray(coarse))[..., None])
    if rng.random() < 0.4:
        size = rng.uniform(0.3, 0.7)
        j, i = _cells(rows, columns, texel, size)
        image *= 1 + rng.uniform(0.02, 0.15) * (((i + j) % 2)[..., None] - 0.5)
    return np.asarray(image, np.float32)


def _cells(rows: int, columns: int, texel: float, size: float) -> tuple[Tone, Tone]:
    j, i = (np.floor((np.arange(n) + 0.5) * texel / size).astype(int) for n in (rows, columns))
    return np.broadcast_to(j[:, None], (rows, columns)), np.broadcast_to(i[None, :], (rows, columns))


def _tiles(rows: int, columns: int, texel: float, rng: Rng) -> Image:
    size, gap = rng.uniform(0.1, 0.9), rng.uniform(0.004, 0.02)
    j, i = _cells(rows, columns, texel, size)
    first, second = color(rng), color(rng)
    chequered = rng.random() < 0.25
    image = np.where((((i + j) % 2) * chequered)[..., None] > 0, second, first).astype(np.float32)
    tone = rng.normal(0, rng.uniform(0, 0.08), (64, 64))[j % 64, i % 64]
    tone = tone + rng.uniform(0, 0.06) * _noise_pattern(rows, columns, rng.uniform(0.03, 0.3), texel, rng)
    image = image * (1 + tone[..., None])
    y, x = ((np.arange(n) + 0.5) * texel for n in (rows, columns))
    image[(np.mod(y, size) < gap)[:, None] | (np.mod(x, size) < gap)[None, :]] = first * rng.uniform(0.5, 1.3)
    return image


def _plank_pattern(rows: int, columns: int, texel: float, rng: Rng) -> Image:
    if rng.random() < 0.5:
        return _planks_along(columns, rows, texel, rng).transpose(1, 0, 2)
    return _planks_along(rows, columns, texel, rng)


def _planks_along(rows: int, columns: int, texel: float, rng: Rng) -> Image:
    width, length = rng.uniform(0.05, 0.25), rng.uniform(0.4, 2.5)
    y, x = (np.arange(rows) + 0.5) * texel, (np.arange(columns) + 0.5) * texel
    lane = np.floor(y / width).astype(int)
    along = x[None, :] / length + rng.uniform(0, 1, lane.max() + 1)[lane][:, None]
    index = np.floor(along).astype(int)
    tone = rng.normal(0, rng.uniform(0.02, 0.15), (32, 32))[lane[:, None] % 32, index % 32]
    grain = smooth_noise(rows, columns, (max(0.01 / texel, 1.0), max(0.4 / texel, 1.0)), rng)
    tone = tone + rng.uniform(0.01, 0.08) * grain
    seam = (np.mod(y, width) < rng.uniform(0.002, 0.012))[:, None] | (np.mod(along, 1.0) < 0.006)
    tone = np.where(seam, tone - rng.uniform(0, 0.3), tone)
    return np.asarray(_flat(rows, columns, color(rng)) * (1 + tone[..., None]), np.float32)


def _stone(rows: int, columns: int, texel: float, rng: Rng) -> Image:
    sizes = np.geomspace(0.04, 1.0, 4)
    rough = sum(_noise_pattern(rows, columns, s, texel, rng) * s**0.5 for s in sizes)
    if rng.random() < 0.4:
        rough = np.sin(np.asarray(rough) * rng.uniform(2, 6))  # veins
    if rng.random() < 0.3:
        rough = np.where(_noise_pattern(rows, columns, 0.02, texel, rng) > 1.2, 2.0, rough)  # chips
    shade = 1 + rng.uniform(0.02, 0.15) * np.asarray(rough)[..., None]
    return np.asarray(_flat(rows, columns, color(rng)) * shade, np.float32)


def _stripes(rows: int, columns: int, texel: float, rng: Rng) -> Image:
    y, x = ((np.arange(n) + 0.5) * texel for n in (rows, columns))
    angle, width = rng.choice([0, np.pi / 2, rng.uniform(0, np.pi)]), rng.uniform(0.03, 0.6)
    at = np.mod((np.cos(angle) * x[None, :] + np.sin(angle) * y[:, None]) / width, 1.0)
    return np.where((at < rng.uniform(0.2, 0.8))[..., None], color(rng), color(rng)).astype(np.float32)


def _collage(rows: int, columns: int, texel: float, rng: Rng) -> Image:
    """Overlapping rectangles, like sheets, books and boxes."""
    image = _flat(rows, columns, color(rng))
    for _ in range(int(rng.integers(3, 30))):
        h, w = (max(1, round(rng.uniform(0.03, 0.6) / texel)) for _ in range(2))
        r, c = int(rng.integers(-h, rows)), int(rng.integers(-w, columns))
        image[max(r, 0) : r + h, max(c, 0) : c + w] = color(rng)
    return image


_KINDS: tuple[Callable[[int, int, float, Rng], Image], ...] = (
    _plain_pattern, _plain_pattern, _carpet, _carpet, _tiles, _tiles, _plank_pattern, _plank_pattern, _stone, _stripes,
    _collage,
)  # fmt: skip
