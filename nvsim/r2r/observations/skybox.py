"""The images of one viewpoint: its strip of six faces and its depth strip, and the views.

Format: `<id>_skybox_small.jpg` has six square faces side by side in the order of `nvsim.geometry.directions`. The
chroma is not subsampled, because it would bleed over the borders. `<id>_skybox_depth_small.png` has 16 bits, meters
along the ray times 4000. Where a floor-aware model has no Gaussians, the depth is the distance to the floor. The depth
strips decide which viewpoints see each other, R2R's `visible`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.images import decode_pixels
from nvsim.files.opening import read_bytes
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import face_axes, sweep
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.graph.sight import FARTHEST_SEEN
from nvsim.graph.types import Viewpoint
from nvsim.kernels import njit, prange
from nvsim.r2r.observations.layout import ScanPlaces, ScanSettings, jpeg, png
from nvsim.r2r.observations.surround import Surround, draw_surround
from nvsim.render.arithmetic import FLAGS
from nvsim.render.backends import Backend
from nvsim.render.floor_rays import distance_to_floor, pack_floor
from nvsim.render.kernel_types import Float32
from nvsim.render.workspace import LOCK
from nvsim.splats.types import SubmapModel

SOLID = np.float32(0.5)
"""If alpha is at least this, a ray that meets the floor ends at the Gaussians in front of it."""
VEIL = np.float32(0.1)
"""The same limit for a ray that does not meet the floor. It is lower, because ceilings in few images have low alpha and
nothing else is behind them."""

_F = np.float32
_HALF, _ONE = _F(0.5), _F(1)
UNITS_A_METER = 4000
"""A unit is 0.25 mm; 16 bits reach 16.38 m."""
FINER = 2
"""Samples per pixel of a face in each direction. The narrow views are drawn this much finer."""
_NEAR = 0.25  # a surface occludes a viewpoint if it is at least this many meters in front of it


@njit(parallel=True, cache=True, nogil=True, fastmath=FLAGS, error_model="numpy")
def _refine_depth(
    solid: Float32,  # (H, W, 2) alpha, and alpha times meters along the ray
    rotation: Float32,  # (3, 3) columns right, down and ahead, world
    eye: Float32,  # (3,) meters, world
    focal: np.float32,  # pixels
    heights: Float32,  # the floor, see `pack_floor`
    grid: Float32,
    meters: Float32,  # (H, W) output
) -> None:
    height, width = meters.shape
    for row in prange(height):
        b = (_F(row) + _HALF - _F(height) * _HALF) / focal
        for column in range(width):
            alpha = solid[row, column, 0]
            if alpha >= SOLID:
                meters[row, column] = solid[row, column, 1] / alpha
                continue
            a = (_F(column) + _HALF - _F(width) * _HALF) / focal
            n = _ONE / math.sqrt(a * a + b * b + _ONE)
            x = (rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2]) * n
            y = (rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2]) * n
            z = (rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2]) * n
            distance = distance_to_floor(heights, grid, eye[0], eye[1], eye[2], x, y, z)
            if distance < _F(0):
                distance = solid[row, column, 1] / alpha if alpha >= VEIL else _F(0)
            meters[row, column] = distance


def distances(solid: Float32, camera: Camera, floor: FloorSurface) -> Float32:
    """Computes (H, W) float32 meters along the rays of `camera`, 0 where they meet no surface.

    `solid` (H, W, 2) is alpha, and alpha times the Gaussians' distance in meters. If alpha is at least 0.5, the
    distance is that of the Gaussians, else that of the floor. A mean of both would be a point in the air wherever
    Gaussians of low alpha are above the floor.
    """
    meters = np.empty(solid.shape[:2], np.float32)
    heights, grid = pack_floor(floor)
    rotation, eye = (np.ascontiguousarray(v, np.float32) for v in (camera.rotation, camera.position))
    with LOCK:
        _refine_depth(solid, rotation, eye, np.float32(camera.intrinsics.fx), heights, grid, meters)
    return meters


@dataclass(frozen=True, eq=False)
class Skybox:
    """The strips of one viewpoint.

    color   (S, 6 S, 3) uint8, RGB
    depth   (S, 6 S) uint16, units of 0.25 mm along the ray, 0 if there is no surface, 65535 from 16.38 m on
    """

    color: NDArray[np.uint8]
    depth: NDArray[np.uint16]

    @property
    def faces(self) -> list[NDArray[np.uint8]]:
        """Six faces (S, S, 3) uint8, in the order of the strip."""
        return np.split(self.color, 6, axis=1)


def face_cameras(position: NDArray[np.floating], side: int) -> list[Camera]:
    """Returns six cameras of 90 degrees and `side` x `side` pixels at `position` (3,), for a level pose facing +y."""
    intrinsics = Intrinsics(side, side, side / 2, side / 2, side / 2, side / 2)
    level = camera_pose(np.asarray(position, np.float64), 0.0)
    cameras = []
    for axes in face_axes():
        pose = level.copy()
        pose[:3, :3] = level[:3, :3] @ axes
        cameras.append(Camera(intrinsics, pose))
    return cameras


def focal_of(side: int) -> float:
    """Returns the focal length in pixels of the narrow views for faces of `side` pixels."""
    return FINER * side / 2


def skybox_of(surround: Surround, floor: FloorSurface, side: int) -> Skybox:
    """Returns the strips with faces of `side` pixels. The depth is that of `floor` where there are no Gaussians."""
    strip = Skybox(np.empty((side, 6 * side, 3), np.uint8), np.empty((side, 6 * side), np.uint16))
    for i, camera in enumerate(face_cameras(surround.position, side)):
        color, solid = surround.color_and_solid(camera, FINER)
        columns = slice(i * side, (i + 1) * side)
        strip.color[:, columns] = as_bytes(color)
        strip.depth[:, columns] = as_units(distances(solid, camera, floor))
    return strip


def as_bytes(color: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Converts colors of any shape from 0 to 1 to uint8."""
    return np.asarray(np.clip(color, 0, 1) * np.float32(255) + np.float32(0.5), np.uint8)


def as_units(meters: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Converts meters of any shape to uint16 in the unit of the depth files."""
    units = np.clip(meters.astype(np.float32) * np.float32(UNITS_A_METER), 0, 65535)
    return np.asarray(np.rint(units), np.uint16)


@dataclass(frozen=True, eq=False)
class Images:
    """The images of a viewpoint: its strips, and the 36 views (480, 640, 3) uint8, empty if they are not exported."""

    skybox: Skybox
    views: list[NDArray[np.uint8]]


class Painter:
    """Draws viewpoints one after another and reuses their memory."""

    def __init__(self, settings: ScanSettings, backend: Backend) -> None:
        self._settings, self._backend = settings, backend
        self._last: Surround | None = None

    def draw(self, model: SubmapModel, viewpoint: Viewpoint) -> Images:
        """Draws the images of a viewpoint of `model`. Raises InputError if the backend is not available."""
        at, size = np.array(viewpoint.position), self._settings.size
        surround = self._last = draw_surround(model, at, focal_of(size), self._backend, self._last)
        views = [as_bytes(surround.color(camera)) for camera in sweep(at)] if self._settings.views else []
        return Images(skybox_of(surround, model.floor, size), views)


def encode_images(
    images: Images, viewpoint: Viewpoint, settings: ScanSettings, places: ScanPlaces
) -> list[tuple[Path, bytes]]:
    """Returns paths and contents of the image files."""
    skybox, id = images.skybox, viewpoint.id
    files = [
        (places.skyboxes.strip(id), jpeg(skybox.color, settings.quality, whole_chroma=True)),
        (places.skyboxes.depth(id), png(skybox.depth)),
    ]
    if settings.faces:
        for path, face in zip(places.skyboxes.faces(id), skybox.faces, strict=True):
            files.append((path, jpeg(face, settings.quality, whole_chroma=True)))
    for path, view in zip(places.view_paths(id), images.views, strict=False):
        files.append((path, jpeg(view, settings.quality, whole_chroma=False)))
    return files


def visible_from(places: ScanPlaces, viewpoint: Viewpoint, others: Sequence[Viewpoint]) -> NDArray[np.bool_]:
    """Returns (N,) bool: which of `others` are visible from `viewpoint`, at most 16 m away.

    The depth strip of `viewpoint` must exist. Raises InputError if it is unreadable.
    """
    depth = read_depth(places, viewpoint.id)
    ways = np.array([o.position for o in others], np.float64).reshape(-1, 3) - viewpoint.position
    lengths = np.linalg.norm(ways, axis=1)
    rows, columns = strip_pixels(ways, depth.shape[0])
    seen = depth[rows, columns] / UNITS_A_METER
    return np.asarray((lengths > 0) & (lengths < FARTHEST_SEEN) & ((seen == 0) | (seen > lengths - _NEAR)))


def strip_pixels(ways: NDArray[np.floating], side: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the rows and columns (...) in a strip for world directions (..., 3), for a pose that faces +y.

    `side` is the side of a face in pixels.
    """
    local = np.asarray(ways, np.float64) @ camera_pose(np.zeros(3), 0.0)[:3, :3]
    on_faces = np.einsum("...i,fij->...fj", local, face_axes())
    face = on_faces[..., 2].argmax(axis=-1)
    right, down, ahead = np.moveaxis(np.take_along_axis(on_faces, face[..., None, None], axis=-2)[..., 0, :], -1, 0)
    safe = np.maximum(ahead, 1e-12)
    row, column = (np.floor((1 + v / safe) / 2 * side).clip(0, side - 1).astype(np.int64) for v in (down, right))
    return row, face * side + column


def read_depth(places: ScanPlaces, viewpoint: str) -> NDArray[np.uint16]:
    """Reads the depth strip (S, 6 S) uint16 of a viewpoint. Raises InputError if it is unreadable."""
    import cv2

    path, again = places.skyboxes.depth(viewpoint), "export the scan again"
    image = decode_pixels(read_bytes(path), path, cv2.IMREAD_UNCHANGED, what="a depth strip", then=again)
    if image.dtype != np.uint16 or image.ndim != 2 or image.shape[1] != 6 * image.shape[0]:
        raise InputError(f"{path} is not a depth strip of six square faces with 16 bits; {again}.")
    return np.asarray(image, np.uint16)
