"""The whole building without ceilings, for a camera above it: one model merged from all submap models.

From above, the model of the nearest submap would show the ceiling of one room. The merged model takes each Gaussian
from its nearest submap, removes Gaussians above door height, and has one texture for all floors. It is for display
only, not for measurements. Does not use Qt.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.harmonics import terms
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import FloorTexture, Gaussians, SubmapModel, select_gaussians
from nvsim.submaps.split import Submap
from nvsim_app.drawing.painter import EYE_HEIGHT
from nvsim_app.drawing.renderer_choice import largest_gaussians

CUT = 1.9  # meters above the floor; higher Gaussians are removed
OUTSIDE = 2.6  # meters above the floor; a higher camera is outside the rooms and sees the whole building
MOST = 400_000  # maximum number of Gaussians; those that cover the smallest area are removed first
TEXEL = 0.05  # meters
REACH = 6.0  # meters from the trajectory within which floor is shown
HIDDEN = 0.4  # meters by which observed floor is extended
GROUND = (0.10, 0.11, 0.13)  # color of the area around the building


class Cutaway:
    """The merged model without ceilings, built when first used.

    submaps    the submaps of the scene
    is_floor   maps world x, y (..., 2) in meters to (...) bool, whether an image shows floor; None if not recorded
    """

    def __init__(
        self,
        scene: SceneModel,
        submaps: tuple[Submap, ...],
        is_floor: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None = None,
    ) -> None:
        from scipy.spatial import cKDTree

        self._scene, self._is_floor = scene, is_floor
        self._submaps = [s for s in submaps if s.index in scene.indices]
        self._tree = cKDTree(np.concatenate([s.positions[:, :2] for s in self._submaps]))
        self._owners = np.concatenate([np.full(len(s.positions), s.index) for s in self._submaps])
        self._model: SubmapModel | None = None

    def is_outside(self, position: NDArray[np.floating]) -> bool:
        """Whether a camera at `position` ((3,) meters, world) is above the rooms."""
        heights = np.concatenate([s.positions[:, 2] for s in self._submaps])
        _, nearest = self._tree.query(np.asarray(position)[:2])
        return bool(position[2] - (heights[nearest] - EYE_HEIGHT) > OUTSIDE)

    @property
    def model(self) -> SubmapModel:
        """The merged model. Raises InputError if the files of a submap cannot be read."""
        if self._model is None:
            self._model = self._build()
        return self._model

    def _owner_of(self, xy: NDArray[np.floating]) -> tuple[NDArray[np.int64], NDArray[np.floating]]:
        distance, nearest = self._tree.query(xy)
        return self._owners[nearest], distance

    def _build(self) -> SubmapModel:
        low = self._tree.mins - REACH - 2 * TEXEL
        columns, rows = np.ceil((self._tree.maxes + REACH - low) / TEXEL).astype(int) + 2
        x = low[0] + (np.arange(columns) + 0.5) * TEXEL
        y = low[1] + (np.arange(rows) + 0.5) * TEXEL
        grid = np.stack(np.meshgrid(x, y), axis=-1)
        owner, distance = self._owner_of(grid.reshape(-1, 2))
        shown = (distance <= REACH).reshape(rows, columns)
        if self._is_floor is not None:
            from scipy.ndimage import binary_dilation

            # Extend the floor under furniture, but not beyond the walls.
            shown &= binary_dilation(self._is_floor(grid), iterations=round(HIDDEN / TEXEL))
        owner = np.where(shown, owner.reshape(rows, columns), -1)
        colors = np.tile(np.array(GROUND, np.float32), (rows, columns, 1))
        parts: list[Gaussians] = []
        heights: list[float] = []
        for submap in self._submaps:
            model = self._scene.model(submap.index)
            # Thin after each submap, so that at most two sets of Gaussians are in memory. The result is the same.
            joined = _joined([*parts, self._part(model, submap.index)])
            parts = [select_gaussians(joined, largest_gaussians(joined, MOST)) if len(joined) > MOST else joined]
            heights.append(float(np.median(model.floor.height_at(submap.positions[:, :2]))))
            mine = owner == submap.index
            colors[mine] = floor_colors(model, grid[mine], submap.positions.mean(axis=0))
        high = (float(low[0] + columns * TEXEL), float(low[1] + rows * TEXEL))
        texture = FloorTexture((np.clip(colors, 0, 1).astype(np.float32),), (float(low[0]), float(low[1])), high)
        return SubmapModel(parts[0], None, texture, FloorSurface.flat(float(np.median(heights))))

    def _part(self, model: SubmapModel, index: int) -> Gaussians:
        g = model.gaussians
        owner, distance = self._owner_of(g.means[:, :2])
        above = g.means[:, 2] - model.floor.height_at(g.means[:, :2])
        return select_gaussians(g, (owner == index) & (above < CUT) & (above > -0.5) & (distance < 2 * REACH))


def _joined(parts: list[Gaussians]) -> Gaussians:
    degree = min(p.sh_degree for p in parts)
    k = (degree + 1) ** 2
    return Gaussians(
        np.concatenate([p.means for p in parts]),
        np.concatenate([p.log_scales for p in parts]),
        np.concatenate([p.quats for p in parts]),
        np.concatenate([p.opacity_logits for p in parts]),
        np.ascontiguousarray(np.concatenate([p.sh[:, :k] for p in parts])),
    )


def floor_colors(model: SubmapModel, xy: NDArray[np.floating], eye: NDArray[np.floating]) -> NDArray[np.float32]:
    """(N, 3) float32 colors of the model's floor at world x, y (N, 2), seen from `eye` (3,); meters.

    `eye` must be near the trajectory, because the background is undefined for a camera above the roof."""
    from scipy.ndimage import map_coordinates

    result = np.zeros((len(xy), 3), np.float32)
    if model.background is not None:
        toward = np.column_stack([xy - eye[:2], model.floor.height_at(xy) - eye[2]])
        toward /= np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-9)
        basis = np.stack(np.broadcast_arrays(*terms(toward[:, 0], toward[:, 1], toward[:, 2])), axis=1)
        result += basis.astype(np.float32) @ model.background.coefficients(eye)
    if model.texture is not None:
        t = model.texture
        share = (xy - np.array(t.low)) / (np.array(t.high) - np.array(t.low))
        for level in t.levels:
            rows, columns = level.shape[:2]
            at = np.stack([share[:, 1] * rows - 0.5, share[:, 0] * columns - 0.5])
            for c in range(3):
                result[:, c] += map_coordinates(level[..., c], at, order=1, mode="nearest")
    return result
