"""Which floor anybody has seen: the map builder walks only there. Beyond a wall, inside furniture and in a room nobody
saw, nothing is rendered either; only support tells them from floor."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.atomic import replacing
from nvsim.capture.types import Cloud
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class FloorSupport:
    """cells    (rows, columns) bool, True where there is floor; row follows y, column x
    origin   (x, y) metres of the lower corner of cell [0, 0]
    spacing  metres per cell
    """

    cells: Mask
    origin: tuple[float, float]
    spacing: float

    def at(self, xy: NDArray[np.floating]) -> Mask:
        """Whether world points (..., 2) are supported, (...) bool; False outside the grid."""
        with np.errstate(invalid="ignore"):
            c = np.floor((xy[..., 0] - self.origin[0]) / self.spacing)
            r = np.floor((xy[..., 1] - self.origin[1]) / self.spacing)
            inside = (c >= 0) & (c < self.cells.shape[1]) & (r >= 0) & (r < self.cells.shape[0])
        index = np.where(inside, r, 0).astype(np.int64), np.where(inside, c, 0).astype(np.int64)
        supported: Mask = self.cells[index] & inside
        return supported

    def save(self, path: Path) -> None:
        """Writes an .npz. Raises InputError when the disk refuses."""
        with replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, cells=self.cells, origin=np.array(self.origin), spacing=np.array(self.spacing))

    @staticmethod
    def load(path: Path) -> FloorSupport:
        """Reads what `save` wrote. Raises InputError for a file that is missing or something else."""
        try:
            with np.load(path) as data:
                cells, origin, spacing = data["cells"].astype(bool), data["origin"], float(data["spacing"])
        except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(
                f"The floor support {path} cannot be read ({error}); make the floor masks again."
            ) from error
        return FloorSupport(cells, (float(origin[0]), float(origin[1])), spacing)


@dataclass(frozen=True)
class SupportConfig:
    """Lengths in metres.

    spacing    edge of a cell
    distance   a mask speaks only for floor this close to its camera: further away a pixel covers too much of it
    tolerance  a cloud point this close to the floor height supports it
    height     cloud points from `tolerance` to this height above the floor contradict the masks in their cell
    views      a cell that masks alone support was seen as floor at least this often
    """

    spacing: float = 0.08
    distance: float = 6.0
    tolerance: float = 0.04
    height: float = 1.5
    views: int = 2


def observe(
    cameras: Iterable[Camera],
    masks: Iterable[Mask],
    surface: FloorSurface,
    cloud: Cloud | None,
    config: SupportConfig | None = None,
) -> FloorSupport:
    """Floor that the masks (each (H, W) bool, of the camera at the same place in `cameras`) or the cloud support.

    Every mask is laid onto the floor surface: a cell is supported when it was seen as floor in at least `views` frames
    and more often than as something else, or when a cloud point lies there at floor height; not when the cloud shows
    something standing there that the masks did not see as floor. A cell surrounded by supported ones is supported.
    """
    import cv2

    config = config or SupportConfig()
    views, pictures = list(cameras), list(masks)
    if len(views) != len(pictures):
        raise ValueError(f"{len(views)} cameras but {len(pictures)} masks")
    places = np.array([c.position[:2] for c in views]).reshape(-1, 2)
    near_cloud = None if cloud is None else np.asarray(cloud.points, np.float64)
    if near_cloud is not None and len(places):
        low, high = places.min(axis=0) - 2 * config.distance, places.max(axis=0) + 2 * config.distance
        near_cloud = near_cloud[((near_cloud[:, :2] > low) & (near_cloud[:, :2] < high)).all(axis=1)]
    corners = [places - config.distance, places + config.distance]
    if near_cloud is not None:
        corners.append(near_cloud[:, :2])
    everything = np.concatenate(corners)
    low = everything.min(axis=0) if len(everything) else np.zeros(2)
    high = everything.max(axis=0) if len(everything) else np.ones(2)
    origin = np.floor(low / config.spacing) * config.spacing
    columns, rows = (np.ceil((high - origin) / config.spacing).astype(int) + 1).tolist()

    def cell(xy: NDArray[np.floating]) -> NDArray[np.int64]:
        index = np.floor((xy - origin) / config.spacing).astype(np.int64)
        flat: NDArray[np.int64] = index[..., 1] * columns + index[..., 0]
        return flat

    as_floor, as_other = np.zeros(rows * columns, np.int32), np.zeros(rows * columns, np.int32)
    for camera, mask in zip(views, pictures):
        # A pixel every few centimetres at the far end is enough; a cell counts once per frame, by its majority.
        view = Camera(camera.intrinsics.within(240), camera.camera_to_world)
        size = (view.intrinsics.width, view.intrinsics.height)
        small = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.5
        rays = view.rays()
        distance = surface.meet(view.position, rays)
        near = distance * np.hypot(rays[..., 0], rays[..., 1]) < config.distance
        index = cell(view.position[:2] + distance[near][:, None] * rays[near][:, :2])
        cells, which = np.unique(index, return_inverse=True)
        floor = np.bincount(which.reshape(-1), small[near], len(cells))
        total = np.bincount(which.reshape(-1), minlength=len(cells))
        as_floor[cells[2 * floor > total]] += 1
        as_other[cells[2 * floor <= total]] += 1
    supported = (as_floor >= config.views) & (as_floor > as_other)
    if near_cloud is not None and len(near_cloud):
        above = near_cloud[:, 2] - surface.height_at(near_cloud[:, :2])
        index = cell(near_cloud[:, :2])
        on_floor = np.zeros(rows * columns, bool)
        on_floor[index[np.abs(above) <= config.tolerance]] = True
        standing = np.zeros(rows * columns, bool)
        standing[index[(above > config.tolerance + 0.02) & (above < config.height)]] = True
        supported |= on_floor & ~(standing & (as_other > as_floor))
    grid = supported.reshape(rows, columns).astype(np.uint8)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    closed = cv2.morphologyEx(grid, cv2.MORPH_CLOSE, cross) > 0
    return FloorSupport(closed, (float(origin[0]), float(origin[1])), config.spacing)
