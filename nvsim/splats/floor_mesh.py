"""Export the floor of a submap model as a textured mesh, or as Gaussians, for programs without a background model. The
color that a person nearby would see at each point is baked."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats import harmonics
from nvsim.splats.types import Gaussians, SubmapModel

EYE_HEIGHT = 1.5
"""Height in meters above the floor of the eyes for which colors are baked..."""
AWAY = 2.0
"""...their horizontal distance in meters..."""
HEADINGS = 8
"""...and the number of directions that are averaged."""
SHADE_SPACING = 0.5
"""Meters between the points at which the background network is evaluated. Colors between them are interpolated."""
LARGEST_CELL = 0.5
"""Meters: largest side of the mesh's rectangles if the floor is not flat."""

GAUSSIAN_SPACING = 0.05
"""Meters between the Gaussians of a floor."""


@dataclass(frozen=True, eq=False)
class FloorMesh:
    """A textured mesh in world x, y, z up, meters.

    vertices    (V, 3) float32
    uvs         (V, 2) float32, 0 to 1; u follows x, v follows y, (0, 0) is the corner of image row 0, column 0
    triangles   (T, 3) uint32, counter-clockwise seen from above
    image       (rows, columns, 4) uint8, RGB and whether the floor is known at the pixel (255) or not (0); row follows
                y
    """

    vertices: NDArray[np.float32]
    uvs: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    image: NDArray[np.uint8]


def floor_mesh(model: SubmapModel) -> FloorMesh | None:
    """The floor below the texture of `model`. None if the model has no texture."""
    if model.texture is None or not model.texture.levels:
        return None
    low, high = np.array(model.texture.low), np.array(model.texture.high)
    vertices, uvs, triangles = _surface(model.floor, low, high)
    return FloorMesh(vertices, uvs, triangles, _picture(model, low, high))


def floor_gaussians(model: SubmapModel) -> Gaussians | None:
    """The known floor below the texture of `model` as flat opaque Gaussians in world x, y, z up, meters, with as many
    coefficients of color as those of the model. None if the model has no texture."""
    if model.texture is None or not model.texture.levels:
        return None
    low, high = np.array(model.texture.low), np.array(model.texture.high)
    columns, rows = np.maximum(np.round((high - low) / GAUSSIAN_SPACING).astype(np.int64), 1)
    image = cv2.resize(_picture(model, low, high), (int(columns), int(rows)), interpolation=cv2.INTER_AREA)
    row, column = np.nonzero(image[..., 3] > 127)
    xy = low + (np.stack([column, row], axis=1) + 0.5) * (high - low) / (columns, rows)
    count = len(xy)
    sh = np.zeros((count, model.gaussians.sh.shape[1], 3), np.float32)
    sh[:, 0] = (image[row, column, :3] / 255 - 0.5) / harmonics.DC
    flat = np.log([0.6 * GAUSSIAN_SPACING, 0.6 * GAUSSIAN_SPACING, 0.002]).astype(np.float32)
    return Gaussians(
        np.column_stack([xy, model.floor.height_at(xy)]).astype(np.float32),
        np.tile(flat, (count, 1)),
        np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        np.full(count, 5.0, np.float32),
        sh,
    )


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

    def fit(image: NDArray[np.float32], how: int = cv2.INTER_LINEAR) -> NDArray[np.float32]:
        return np.asarray(cv2.resize(image, (columns, rows), interpolation=how), np.float32)

    color = fit(_shade(model, low, high))
    known = np.zeros((rows, columns), np.bool_)
    for index, level in enumerate(levels):
        color += fit(level)
        if index > 0 or len(levels) == 1:  # the coarsest texels extend far beyond the observed floor
            # Texels that no image shows keep their initial value 0.
            touched = np.asarray(level.any(axis=2), np.float32)
            known |= fit(touched, cv2.INTER_NEAREST) > 0
    image = np.empty((rows, columns, 4), np.uint8)
    image[..., :3] = np.round(255 * np.clip(color, 0, 1))
    image[..., 3] = 255 * known
    return image


def _shade(model: SubmapModel, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float32]:
    """(rows, columns, 3) the background's color at points of the floor, averaged over eyes around each point."""
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
