"""The floor of a storey as one albedo image: tiles, planks, and rugs with detail of 3 cm and more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.building.painting import Image, blotches
from nvsim.building.plan import Plan, Rect, Room

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
                patch, shine = _planks(r0, r1, c0, c1, texel, plank, wood_color, rng), 0.6
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
    tone = tone + 0.06 * blotches(*shape, (0.07 / texel, 0.07 / texel), rng)
    grout = (np.mod(y, size) < 0.018)[:, None] | (np.mod(x, size) < 0.018)[None, :]
    tone = np.where(grout, -0.24, tone)
    return (color + tone[..., None]).astype(np.float32)


def _planks(
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
    tone = tone + 0.06 * blotches(rows, columns, (0.035 / texel, 0.5 / texel), rng)
    seam = (np.mod(y, width) < 0.012)[:, None] | (np.mod(along, 1.0) < 0.01)
    tone = np.where(seam, tone - 0.12, tone)
    image = (color * (1 + 2.2 * tone[..., None])).astype(np.float32)
    return image.transpose(1, 0, 2) if turned else image


def _rug_place(room: Room, rng: np.random.Generator) -> Rect:
    area = room.rects[0]
    x, y = area.centre
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
    return (image * (1 + 0.05 * blotches(rows, columns, (0.05 / texel, 0.05 / texel), rng)[..., None])).astype(
        np.float32
    )
