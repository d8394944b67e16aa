"""Reliable labels of an image from the point cloud: floor, other, and surface normals.

Pixels stay unknown where the cloud is sparse, at silhouettes, and at heights between floor and obstacles. They also
stay unknown where the image and the cloud differ in color: the image then shows an object that the cloud lacks, such as
a chair, a pane, or a table leg."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.nearest_points import axes_of
from nvsim.geometry.splatting import SplatCloud

FLOOR, OTHER, UNKNOWN = 1, 0, 255
_NEIGHBORS = 40
_LEVEL, _STANDING = 0.05, 0.1  # meters from the floor: a point is floor up to the first, and other from the second on
_FLAT = 0.3  # ratio of thickness to width below which a neighborhood is a surface
_COVER = 0.75  # half-width of a point's square, in distances to its fourth neighbor
_LOOSE = 2.5  # points this many times as far from their neighbors as usual are noise
_THIN, _WIDEST = 1.4, 0.1  # times as far apart as usual, and meters: squares that make covered pixels unknown
_BEHIND = 0.03  # share of the inverse depth: such a pixel is seen between the points of a nearer surface
_LIGHTER, _TINGED = 30, 25  # CIELAB: if the image differs by more, beyond its exposure, it shows another object
_CHUNK = 50_000
_Shape = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]


@dataclass(frozen=True, eq=False)
class CloudLabels:
    """A point cloud with cached per-point data for making labels."""

    cloud: Cloud

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.cloud.points)

    @cached_property
    def _shape(self) -> _Shape:
        """Per point, in this order:

        - half-width (N,) of its square, meters, 0 for noise
        - half-width (N,) of the square that makes pixels unknown, meters, 0 for points that are not sparse
        - normal (N, 3), either sign
        - whether it is on a surface (N,)
        """
        points = self.cloud.points
        apart, normals = np.empty(len(points), np.float32), np.empty((len(points), 3), np.float32)
        flat = np.empty(len(points), bool)
        for at in range(0, len(points), _CHUNK):
            part = slice(at, at + _CHUNK)
            distance, index = self._tree.query(points[part], k=_NEIGHBORS, workers=1)
            around = points[index]
            axes = axes_of(around)
            spread = np.abs(np.einsum("nkj,nji->nki", around - around.mean(axis=1, keepdims=True), axes)).mean(axis=1)
            apart[part], normals[part] = distance[:, 4], axes[..., 0]
            flat[part] = spread[:, 0] < _FLAT * spread[:, 1]
        usual, wide = np.median(apart), _COVER * apart
        loose = apart > _LOOSE * usual
        thin = np.where(apart > _THIN * usual, np.minimum(wide, _WIDEST), 0).astype(np.float32)
        return np.where(loose, 0, wide).astype(np.float32), thin, normals, flat & ~loose

    @cached_property
    def _splats(self) -> tuple[SplatCloud, SplatCloud]:
        """The splats of all points, and those of the sparse points that make pixels unknown."""
        points, (radii, thin, _, _) = self.cloud.points.astype(np.float32), self._shape
        return SplatCloud.of(points, radii), SplatCloud.of(points[thin > 0], thin[thin > 0])

    def of(
        self, camera: Camera, surface: FloorSurface, image: NDArray[np.uint8] | None = None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Labels (H, W) uint8 FLOOR, OTHER, or UNKNOWN, and unit normals (H, W, 3) float32 in the world, toward the
        camera, zero if unknown. Both are computed at half the size of the camera's image. `surface` is the floor there.
        If `image` (H, W, 3) uint8 RGB is given and the cloud has colors, pixels of another color are unknown too."""
        k = camera.intrinsics
        small = camera.scaled(max(1, k.width // 2), max(1, k.height // 2))
        radii, _, normals, flat = self._shape
        said_by, left_unsaid = self._splats
        depth, _ = said_by.depth(small)
        unsaid, _ = left_unsaid.depth(small)
        rows, columns = np.nonzero(np.isfinite(depth) & ~_has_nearer_neighbor(depth))
        rays = small.rays()[rows, columns]
        places = small.position + (depth[rows, columns] / (rays @ small.rotation[:, 2]))[:, None] * rays
        _, index = self._tree.query(places, workers=1)
        facing = normals[index] * -np.sign(np.sum(normals[index] * rays, axis=1, keepdims=True))
        height = places[:, 2] - surface.height_at(places[:, :2])
        alike = np.ones(len(rows), bool)
        if image is not None and self.cloud.colors is not None:
            alike = _similar_pixels(image, depth.shape, rows, columns, self.cloud.colors[index])
        said = np.full(len(rows), UNKNOWN, np.uint8)
        said[(np.abs(height) > _STANDING) & (radii[index] > 0)] = OTHER
        said[(np.abs(height) < _LEVEL) & (facing[:, 2] > 0.8)] = FLOOR
        floor = np.full(depth.shape, UNKNOWN, np.uint8)
        floor[rows, columns] = np.where(alike, said, UNKNOWN)
        # A few points before a surface are an object that the scanner mostly missed, or a mixed pixel at an edge.
        floor[unsaid <= depth] = UNKNOWN
        found = np.zeros((*depth.shape, 3), np.float32)
        found[rows, columns] = np.where((flat[index] & alike)[:, None], facing, 0)
        size = k.width, k.height
        return (
            np.asarray(cv2.resize(floor, size, interpolation=cv2.INTER_NEAREST), np.uint8),
            np.asarray(cv2.resize(found, size, interpolation=cv2.INTER_NEAREST), np.float32),
        )


def _similar_pixels(
    image: NDArray[np.uint8], shape: tuple[int, ...], rows: NDArray[np.intp], columns: NDArray[np.intp],
    colors: NDArray[np.uint8],
) -> NDArray[np.bool_]:  # fmt: skip
    """(N,) bool: which of N pixels of an image resized to `shape` have the color of the cloud points (N, 3) seen there.
    A difference in exposure is removed."""
    small = cv2.resize(image, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    seen, known = (
        cv2.cvtColor(c.reshape(1, -1, 3).astype(np.float32) / 255, cv2.COLOR_RGB2LAB)[0]
        for c in (small[rows, columns], colors)
    )
    off = seen - known
    if len(off):
        off[:, 0] -= np.median(off[:, 0])
    return np.asarray((np.abs(off[:, 0]) < _LIGHTER) & (np.hypot(off[:, 1], off[:, 2]) < _TINGED))


def _has_nearer_neighbor(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) bool: whether a nearer surface is beside a pixel. On a plane the inverse depth is linear, so it differs as
    much from the greatest value around it as from the least."""
    inverse = 1 / depth
    around = np.ones((5, 5), np.uint8)
    most, least = cv2.dilate(inverse, around), cv2.erode(inverse, around)
    return np.asarray(most - inverse > 2 * (inverse - least) + _BEHIND * inverse)
