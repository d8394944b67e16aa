"""A storey seen from above, cut off below its ceiling: the floor as the models paint it, and the Gaussians on it.

Every pixel is of the submap whose camera on the storey passed nearest, so that no two models are in memory at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.render.kernel_types import Float32
from nvsim.render.model import render_model
from nvsim.render.workspace import tiles_of
from nvsim.splats import harmonics
from nvsim.splats.floor_mesh import floor_mesh
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import Gaussians, SubmapModel

CUT = 1.9
"""Metres above the floor; what is higher is left out."""
_BELOW = -0.3  # metres; what lies deeper belongs to no room
_REACH = 4.0  # metres around the cameras that the plan shows
_LONGEST = 2048  # pixels
_FINEST = 0.01  # metres a pixel
_ALTITUDE = 2000.0  # metres: from there the top of a wall is a pixel off its foot
_COARSER = 8  # pixels of a cell of which one submap is asked
_PAPER = np.float32(0.96)


@dataclass(frozen=True)
class Frame:
    """Where a plan lies in the world: +x to the right, +y up the page; `low`, `high` (x, y) metres are the outer edges
    of the image of `width` x `height` pixels, each `metres` wide."""

    low: tuple[float, float]
    high: tuple[float, float]
    metres: float
    width: int
    height: int

    @staticmethod
    def around(positions: NDArray[np.floating]) -> Frame:
        """The frame that shows what is near positions (N, 2 or more), metres."""
        low, high = positions[:, :2].min(axis=0) - _REACH, positions[:, :2].max(axis=0) + _REACH
        metres = max(_FINEST, float((high - low).max()) / _LONGEST)
        width, height = (math.ceil(float(side) / metres) for side in high - low)
        left, top = float(low[0]), float(low[1]) + height * metres
        return Frame((left, float(low[1])), (left + width * metres, top), metres, width, height)

    @property
    def world_to_pixel(self) -> list[list[float]]:
        """(2, 3) to be applied to x, y, 1: column and row, where (0.5, 0.5) is the centre of the first pixel."""
        s = 1 / self.metres
        return [[s, 0.0, -self.low[0] * s], [0.0, -s, self.high[1] * s]]

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Column and row of a place, metres."""
        return (x - self.low[0]) / self.metres, (self.high[1] - y) / self.metres

    def centres(self) -> NDArray[np.float64]:
        """(height, width, 2) x, y of the pixels' centres, metres."""
        x = self.low[0] + (np.arange(self.width) + 0.5) * self.metres
        y = self.high[1] - (np.arange(self.height) + 0.5) * self.metres
        return np.stack(np.meshgrid(x, y), axis=-1)

    def camera(self) -> Camera:
        """The camera that sees the frame from so high that its rays are nearly parallel."""
        focal = _ALTITUDE / self.metres
        intrinsics = Intrinsics(self.width, self.height, focal, focal, self.width / 2, self.height / 2)
        middle = [(a + b) / 2 for a, b in zip(self.low, self.high, strict=True)]
        return Camera(intrinsics, look(np.array([*middle, _ALTITUDE]), 0.0, -math.pi / 2))


def draw_plan(
    scene: SceneModel, frame: Frame, positions: NDArray[np.floating], owners: NDArray[np.int64]
) -> NDArray[np.uint8]:
    """(height, width, 3) of the storey whose cameras are at `positions` (N, 3), of the submaps `owners` (N,).

    Raises InputError when a model cannot be read.
    """
    from scipy.spatial import cKDTree

    from nvsim.r2r.observations.skybox import as_bytes

    rows, columns = -(-frame.height // _COARSER), -(-frame.width // _COARSER)
    cells = frame.centres()[::_COARSER, ::_COARSER]
    distance, nearest = cKDTree(positions[:, :2]).query(cells)
    owner = np.where(distance <= _REACH, owners[nearest], -1).reshape(rows, columns)
    owner = owner.repeat(_COARSER, axis=0).repeat(_COARSER, axis=1)[: frame.height, : frame.width]
    image = np.full((frame.height, frame.width, 3), _PAPER, np.float32)
    for index in np.unique(owner[owner >= 0]).tolist():
        mine = owner == index
        image[mine] = _seen_from_above(scene.model(index), frame, mine, positions[owners == index])
    return as_bytes(image)


def _seen_from_above(
    model: SubmapModel, frame: Frame, mask: NDArray[np.bool_], cameras: NDArray[np.floating]
) -> Float32:
    """(n, 3) the pixels of `mask` (height, width)."""
    ground = _floor(model, frame, mask)
    standing = replace(model, gaussians=_standing(model, cameras), background=None, texture=None, appearance=None)
    view = render_model(standing, frame.camera(), tiles=tiles_of(mask))
    assert view.rgb is not None and view.alpha is not None
    return np.asarray(view.rgb[mask] + (1 - view.alpha[mask][:, None]) * ground, np.float32)


def _floor(model: SubmapModel, frame: Frame, mask: NDArray[np.bool_]) -> Float32:
    """(n, 3) the colours of the floor at the pixels of `mask`, paper where none is known."""
    import cv2

    mesh = floor_mesh(model)
    if mesh is None:
        return np.full((int(mask.sum()), 3), _PAPER, np.float32)
    low, high = mesh.vertices[:, :2].min(axis=0), mesh.vertices[:, :2].max(axis=0)
    rows, columns = mesh.image.shape[:2]
    share = (frame.centres() - low) / (high - low)
    at = [(share[..., i] * n - 0.5).astype(np.float32) for i, n in ((0, columns), (1, rows))]
    image = mesh.image.astype(np.float32)
    image[..., :3] *= image[..., 3:] / 255
    texels = cv2.remap(image, at[0], at[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[mask] / 255
    texels[((share < 0) | (share > 1)).any(axis=-1)[mask]] = 0  # beyond the texture
    return np.asarray(texels[:, :3] + (1 - texels[:, 3:]) * _PAPER, np.float32)


def _standing(model: SubmapModel, cameras: NDArray[np.floating]) -> Gaussians:
    """The Gaussians between floor and cut, each with the one colour that the camera (N, 3) nearest to it sees: from
    above, where no image was taken, harmonics of the direction mean nothing."""
    from scipy.spatial import cKDTree

    g = model.baked()
    above = g.means[:, 2] - model.floor.height_at(g.means[:, :2])
    rows = np.flatnonzero((above > _BELOW) & (above < CUT))
    means = g.means[rows]
    ways = means - cameras[cKDTree(cameras).query(means)[1]]
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-6)
    weights = harmonics.basis(ways, g.sh_degree)
    colours = np.maximum(0.5 + np.einsum("nk,nkc->nc", weights, g.sh[rows]), 0)
    sh = ((colours - 0.5) / harmonics.DC).astype(np.float32)[:, None]
    return Gaussians(means, g.log_scales[rows], g.quats[rows], g.opacity_logits[rows], np.ascontiguousarray(sh))
