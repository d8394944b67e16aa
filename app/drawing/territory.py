"""The submap nearest to each position, and images tinted with the colors of the submaps. Does not use Qt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.look import colors
from nvsim.geometry.camera import Camera
from nvsim.render.backends import RenderOutput
from nvsim.submaps.split import Submap

CELL = 0.2  # meters
REACH = 15.0  # meters around the trajectory; positions farther away belong to no submap
_SOLID = 0.5  # alpha from which a pixel shows a surface in front of the floor
_SHARE = 0.6  # share of the submap's color in the image


class Territory:
    """A grid in plan view that stores the submap whose core cameras are nearest to each cell."""

    def __init__(self, submaps: tuple[Submap, ...], eye_height: float = 1.5) -> None:
        from scipy.spatial import cKDTree

        positions = np.concatenate([s.positions for s in submaps])
        owners = np.concatenate([np.full(len(s.positions), s.index) for s in submaps])
        self._low = positions[:, :2].min(axis=0) - REACH
        columns, rows = np.ceil((positions[:, :2].max(axis=0) + REACH - self._low) / CELL).astype(int)
        x = self._low[0] + (np.arange(columns) + 0.5) * CELL
        y = self._low[1] + (np.arange(rows) + 0.5) * CELL
        distance, nearest = cKDTree(positions[:, :2]).query(np.stack(np.meshgrid(x, y), axis=-1))
        self._owner = np.where(distance <= REACH, owners[nearest], -1)
        self._floor = np.where(distance <= REACH, positions[nearest, 2] - eye_height, np.nan)
        count = int(owners.max()) + 2
        self._colors = np.array([_rgb(index) for index in range(-1, count - 1)], np.float32)

    def owner_at(self, xy: NDArray[np.floating]) -> NDArray[np.int64]:
        """(...) int64 index of the submap nearest to world x, y (..., 2) in meters; -1 far from the trajectory."""
        cells = np.floor((xy - self._low) / CELL)
        rows, columns = self._owner.shape
        inside = ((cells >= 0) & (cells < (columns, rows))).all(axis=-1)
        result = np.full(inside.shape, -1, np.int64)
        at = cells[inside].astype(np.intp)
        result[inside] = self._owner[at[:, 1], at[:, 0]]
        return result

    def tinted(self, view: RenderOutput, camera: Camera) -> NDArray[np.uint8]:
        """(H, W, 4) uint8 image (blue, green, red, 255): the brightness of `view`, tinted with the color of the submap
        nearest to the visible surface. `view` must have rgb, alpha, and depth."""
        assert view.rgb is not None and view.alpha is not None and view.depth is not None
        k = camera.intrinsics
        right, down, forward = camera.rotation.astype(np.float32).T
        u = ((np.arange(k.width, dtype=np.float32) + 0.5 - k.cx) / k.fx)[None, :, None]
        v = ((np.arange(k.height, dtype=np.float32) + 0.5 - k.cy) / k.fy)[:, None, None]
        rays = u * right + v * down + forward  # one meter along the optical axis
        eye = camera.position.astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_floor = (self._floor_under(camera.position) - eye[2]) / rays[..., 2]
            way = np.where((view.alpha >= _SOLID) | ~(to_floor > 0), view.depth, to_floor)
            owners = self.owner_at(eye[:2] + way[..., None] * rays[..., :2])
        light = np.clip(view.rgb @ np.array([0.299, 0.587, 0.114], np.float32), 0, 1)[..., None]
        tint = self._colors[owners + 1]
        result = np.empty((k.height, k.width, 4), np.uint8)
        # The lightness stays readable: the color is mixed with gray, and is brighter in bright parts of the image.
        result[..., :3] = (255 * (_SHARE * tint * (0.35 + 0.65 * light) + (1 - _SHARE) * light))[..., ::-1]
        result[..., 3] = 255
        return result

    def _floor_under(self, position: NDArray[np.floating]) -> np.float32:
        cell = np.floor((np.asarray(position)[:2] - self._low) / CELL).astype(int)
        rows, columns = self._floor.shape
        column, row = np.clip(cell, 0, (columns - 1, rows - 1))
        floor = self._floor[row, column]
        return np.float32(np.nanmedian(self._floor) if np.isnan(floor) else floor)


def _rgb(index: int) -> tuple[float, float, float]:
    text = colors.submap_color(index)
    red, green, blue = (int(text[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue
