"""The floor of a submap model as a textured surface, for programs that know no background model: the colour that people
who walk by see at each spot, baked into an image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats import harmonics
from nvsim.splats.types import SubmapModel

EYE_HEIGHT = 1.5
"""Metres above the floor from which the baked colour is seen..."""
AWAY = 2.0
"""...this many metres away..."""
HEADINGS = 8
"""...from this many sides; the mean is baked."""
SHADE_SPACING = 0.5
"""Metres between the spots at which the background network is asked; between them colours are interpolated."""
LARGEST_CELL = 0.5
"""Metres; sides of the surface's rectangles are at most this long where the floor is not flat."""


@dataclass(frozen=True, eq=False)
class FloorMesh:
    """A textured surface over world x, y, z up, metres.

    vertices    (V, 3) float32
    uvs         (V, 2) float32, 0 to 1; u follows x, v follows y, (0, 0) is the corner of image row 0, column 0
    triangles   (T, 3) uint32, counter-clockwise seen from above
    image       (rows, columns, 4) uint8, RGB and whether the floor is known there (255) or not (0); row follows y
    """

    vertices: NDArray[np.float32]
    uvs: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    image: NDArray[np.uint8]


def floor_mesh(model: SubmapModel) -> FloorMesh | None:
    """The floor under the texture of `model`; None for a model without texture."""
    if model.texture is None or not model.texture.levels:
        return None
    low, high = np.array(model.texture.low), np.array(model.texture.high)
    vertices, uvs, triangles = _surface(model.floor, low, high)
    return FloorMesh(vertices, uvs, triangles, _picture(model, low, high))


def _surface(
    floor: FloorSurface, low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
    cells = np.ones(2, np.int64) if floor.heights.size == 1 else np.ceil((high - low) / LARGEST_CELL).astype(np.int64)
    u, v = np.meshgrid(np.linspace(0, 1, cells[0] + 1), np.linspace(0, 1, cells[1] + 1))
    uvs = np.stack([u, v], axis=-1).reshape(-1, 2)
    xy = low + uvs * (high - low)
    vertices = np.column_stack([xy, floor.height_at(xy)])
    corner = np.arange(u.size).reshape(u.shape)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    triangles = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2).reshape(-1, 3)
    return vertices.astype(np.float32), uvs.astype(np.float32), triangles.astype(np.uint32)


def _picture(model: SubmapModel, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.uint8]:
    assert model.texture is not None
    levels = model.texture.levels
    rows, columns = max(levels, key=lambda level: level.size).shape[:2]

    def fitted(image: NDArray[np.float32], how: int = cv2.INTER_LINEAR) -> NDArray[np.float32]:
        return np.asarray(cv2.resize(image, (columns, rows), interpolation=how), np.float32)

    colour = fitted(_shade(model, low, high))
    known = np.zeros((rows, columns), np.bool_)
    for index, level in enumerate(levels):
        colour += fitted(level)
        if index > 0 or len(levels) == 1:  # the coarsest texels reach far beyond what was seen
            # Texels that no view has shown were never moved.
            touched = np.asarray(level.any(axis=2), np.float32)
            known |= fitted(touched, cv2.INTER_NEAREST) > 0
    image = np.empty((rows, columns, 4), np.uint8)
    image[..., :3] = np.round(255 * np.clip(colour, 0, 1))
    image[..., 3] = 255 * known
    return image


def _shade(model: SubmapModel, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float32]:
    """(rows, columns, 3): the background's colour at spots of the floor, as its viewers around see it."""
    columns, rows = np.maximum(np.round((high - low) / SHADE_SPACING).astype(np.int64), 1)
    shade = np.zeros((rows, columns, 3), np.float32)
    if model.background is None:
        return shade
    x = low[0] + (np.arange(columns) + 0.5) * (high[0] - low[0]) / columns
    y = low[1] + (np.arange(rows) + 0.5) * (high[1] - low[1]) / rows
    heights = model.floor.height_at(np.stack(np.meshgrid(x, y), axis=-1))
    angles = 2 * np.pi * np.arange(HEADINGS) / HEADINGS
    offsets = np.column_stack([AWAY * np.sin(angles), AWAY * np.cos(angles), np.full(HEADINGS, EYE_HEIGHT)])
    looks = harmonics.basis(-offsets / np.linalg.norm(offsets, axis=1, keepdims=True), 4)
    for r in range(rows):
        for c in range(columns):
            spot = np.array([x[c], y[r], heights[r, c]])
            seen = [look @ model.background.coefficients(spot + o) for look, o in zip(looks, offsets, strict=True)]
            shade[r, c] = np.mean(seen, axis=0)
    return shade
