"""Find floaters and fog, which views of the free space see through, and Gaussians outside the building."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.types import Gaussians, SubmapModel, select_gaussians

if TYPE_CHECKING:
    from nvsim.scene_import.levels import Level

_VIEWS, _SIDE = 24, 160  # positions of cameras per storey; pixels per side of their square views
_NEAREST, _FARTHEST = 0.3, 4.0  # meters from a camera to Gaussians that it judges
_BEFORE = 0.2  # meters between a Gaussian and the surface behind it, at least
_SHARE, _LEAST = 0.8, 3  # of the views of a Gaussian that see through it; number of its views
_ROUNDS, _FEW = 4, 0.05  # of the search, at most; share of new Gaussians that ends it
_OUTSIDE = 3.0  # meters from known floor, seen from above
Reason = Literal["floater", "outside"]
"""Why a Gaussian should be removed. floater: most views of the free space see through it, as through floaters, fog, and
faint glass; outside: it is far from the floor of the building."""
REASONS: tuple[Reason, ...] = get_args(Reason)


def find_candidates(gaussians: Gaussians, levels: tuple[Level, ...], height: float) -> dict[Reason, NDArray[np.bool_]]:
    """Reason -> (N,) bool, the Gaussians that should be removed for it. Each Gaussian has at most one reason.

    levels  all storeys
    height  of the viewpoints above the floor, meters
    """
    outside = far_from_floor(gaussians, levels)
    return {"floater": floaters(gaussians, levels, height) & ~outside, "outside": outside}


def floaters(gaussians: Gaussians, levels: tuple[Level, ...], height: float) -> NDArray[np.bool_]:
    """(N,) bool, the Gaussians that most views from `height` meters above free floor see through: the depth behind them
    is visible around their middle. The outer Gaussians of dense fog hide the inner ones, so the search is repeated
    without the Gaussians that were found."""
    found = np.zeros(len(gaussians), bool)
    for _ in range(_ROUNDS):
        rows = np.flatnonzero(~found)
        new = _seen_through(select_gaussians(gaussians, rows), levels, height)
        found[rows[new]] = True
        if new.sum() <= _FEW * found.sum():
            break
    return found


def _seen_through(gaussians: Gaussians, levels: tuple[Level, ...], height: float) -> NDArray[np.bool_]:
    """(N,) bool, the result of one round of `floaters`."""
    from scipy.ndimage import minimum_filter

    from nvsim.render.scene import render_regions  # imports numba, which takes long

    model = SubmapModel(gaussians, None, None, FloorSurface.flat(0.0))
    intrinsics = Intrinsics.from_fov(_SIDE, _SIDE, np.pi / 2)
    seen, through = np.zeros(len(gaussians), np.int32), np.zeros(len(gaussians), np.int32)
    everything = np.ones((_SIDE, _SIDE), bool)
    for level in levels:
        for place in level.places[_spread_views(level.places)]:
            eye = place + [0.0, 0.0, height]
            cameras = [Camera(intrinsics, camera_pose(eye, k * np.pi / 2)) for k in range(4)]
            near = np.flatnonzero((np.abs(gaussians.means - eye) < _FARTHEST).all(axis=1))
            views = render_regions(model, cameras, [everything] * 4, frozenset({"depth"}))
            for camera, view in zip(cameras, views, strict=True):
                assert view.depth is not None  # it was rendered
                pixels, depth = camera.project(gaussians.means[near].astype(np.float64))
                column, row = np.floor(np.nan_to_num(pixels, nan=-1.0, posinf=-1.0, neginf=-1.0)).astype(np.int64).T
                inside = (depth > _NEAREST) & (depth < _FARTHEST)
                inside &= (column >= 0) & (row >= 0) & (column < _SIDE) & (row < _SIDE)
                behind = minimum_filter(view.depth, size=3)[row[inside], column[inside]]
                visible = depth[inside] < behind + _BEFORE
                seen[near[inside]] += visible
                through[near[inside]] += depth[inside] < behind - _BEFORE
    return np.asarray((seen >= _LEAST) & (through >= _SHARE * seen))


def far_from_floor(gaussians: Gaussians, levels: tuple[Level, ...]) -> NDArray[np.bool_]:
    """(N,) bool, the Gaussians that are far from the known floor of all storeys, seen from above."""
    from scipy.ndimage import distance_transform_edt

    far = np.ones(len(gaussians), bool)
    for level in levels:
        if level.known.any():
            margin = round(_OUTSIDE / level.grid.spacing) + 1
            away = distance_transform_edt(~np.pad(level.known, margin)) * level.grid.spacing
            cells = np.clip(level.grid.cells_of(gaussians.means) + margin, 0, np.array(away.shape) - 1)
            far &= away[cells[:, 0], cells[:, 1]] > _OUTSIDE
    return far


def _spread_views(places: NDArray[np.float64]) -> list[int]:
    """Rows of at most _VIEWS places (N, 3), each far from those before."""
    rows = [0]
    apart = np.linalg.norm(places - places[0], axis=1)
    while len(rows) < min(_VIEWS, len(places)):
        rows.append(int(apart.argmax()))
        apart = np.minimum(apart, np.linalg.norm(places - places[rows[-1]], axis=1))
    return rows
