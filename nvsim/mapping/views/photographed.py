"""Measure the photographed share of a viewpoint: the directions of its panorama that show surfaces that images show.

There are two sources of evidence. The model itself shows which directions have a surface: haze has a low alpha or
consists of Gaussians that are thick on screen. The training images show which surfaces are known: a surface is
photographed if it is inside an image, and the model seen from that image has its nearest surface there. Splats
without images have only the first source.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.directions import cube
from nvsim.render.backends import Backend
from nvsim.render.geometry_views import neighbor_groups
from nvsim.render.model import render_model
from nvsim.render.nearby import gray_gaussians
from nvsim.render.scene import render_regions
from nvsim.render.workspace import tiles_of
from nvsim.splats.types import SubmapModel

SIDE = 32
"""Pixels per side of the six faces that are measured."""
_IMAGE = 64  # pixels of the longer side of a training image, from which its nearest surfaces are rendered
_SOLID = 0.5  # alpha from which a ray ends at Gaussians
_NEAR, _SHARE = 0.1, 0.1  # meters, and share of the depth: largest distance of a point from the surface of an image
_THICK = 0.1  # radians: least mean thickness on screen of the Gaussians of a direction that is haze
_CHUNK = 64  # images that are rendered at once
_CHANNELS = frozenset({"alpha", "depth"})
_CONSTANT = 0.28209479177387814  # first spherical harmonic

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class TrainingImage:
    """camera   of a training image, with few pixels
    nearest  (H, W) float32 meters along the optical axis, the nearest surface in the pixels around each pixel; inf
             without a surface
    farthest (H, W) float32, the farthest surface in the pixels around each pixel
    """

    camera: Camera
    nearest: NDArray[np.float32]
    farthest: NDArray[np.float32]

    def shows_points(self, points: NDArray[np.float64]) -> Mask:
        """(N,) bool: whether the image shows the surface at each of `points` (N, 3), meters, world."""
        pixels, depth = self.camera.project(points)
        height, width = self.nearest.shape
        u, v = np.floor(np.clip(pixels, -1, 1e6)).astype(np.int64).T
        found = (depth > 0.05) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
        u, v, depth = u[found], v[found], depth[found]
        off = _NEAR + _SHARE * depth
        found[found] = (depth >= self.nearest[v, u] - off) & (depth <= self.farthest[v, u] + off)
        return found


def training_images(model: SubmapModel, cameras: Iterable[Camera], backend: Backend = "auto") -> list[TrainingImage]:
    """The surfaces of `model` that its training images with these `cameras` show. Raises InputError if the backend is
    not available."""
    import cv2

    small = [replace(c, intrinsics=c.intrinsics.limited_to(_IMAGE)) for c in cameras]
    around = np.ones((3, 3), np.uint8)
    found = []
    for start in range(0, len(small), _CHUNK):
        some = small[start : start + _CHUNK]
        masks = [np.ones((c.intrinsics.height, c.intrinsics.width), bool) for c in some]
        for camera, view in zip(some, render_regions(model, some, masks, _CHANNELS, backend), strict=True):
            assert view.alpha is not None and view.depth is not None
            rays = camera.rays()
            along = rays @ camera.rotation[:, 2].astype(np.float32)
            depth = _nearest_surface(
                view.alpha, view.depth, along * model.floor.distance_along_rays(camera.position, rays)
            )
            known = np.isfinite(depth)
            nearest = cv2.erode(depth, around, borderType=cv2.BORDER_REPLICATE).astype(np.float32)
            farthest = cv2.dilate(np.where(known, depth, 0).astype(np.float32), around)
            found.append(TrainingImage(camera, nearest, np.where(farthest > 0, farthest, np.inf).astype(np.float32)))
    return found


def _nearest_surface(
    alpha: NDArray[np.float32], depth: NDArray[np.float32], floor: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Depths of the nearest surfaces from alpha and depth of the Gaussians, and the depth of the `floor`, inf for none.
    A model has no Gaussians on the floor."""
    return np.where(alpha >= _SOLID, depth, floor).astype(np.float32)


def photographed_directions(
    model: SubmapModel,
    position: NDArray[np.floating],
    images: Sequence[TrainingImage] | None,
    backend: Backend = "auto",
) -> Mask:
    """(6, SIDE, SIDE) bool: the directions around `position` (3,), meters, that show a surface which the training
    `images` show. Without images, the directions whose Gaussians are dense and thin. The faces are those of
    `nvsim.geometry.directions.cube` with heading 0.

    Raises InputError if the backend is not available.
    """
    at = np.asarray(position, np.float64)
    cameras = cube(at, SIDE)
    if images is None:
        return np.stack([_is_dense(model, camera, backend) for camera in cameras])
    rays = np.stack([camera.rays() for camera in cameras])
    ahead = [ray @ camera.rotation[:, 2].astype(np.float32) for ray, camera in zip(rays, cameras, strict=True)]
    lengths = (1 / np.stack(ahead)).astype(np.float32)
    masks = [np.ones((SIDE, SIDE), bool)] * len(cameras)
    views = render_regions(model, cameras, masks, _CHANNELS, backend)
    alpha, depth = (np.stack([getattr(view, name) for view in views]) for name in ("alpha", "depth"))
    distance = _nearest_surface(alpha, depth * lengths, model.floor.distance_along_rays(at, rays))
    found = np.zeros(distance.shape, bool)
    rows = np.flatnonzero(np.isfinite(distance))
    points = at + distance.ravel()[rows, None].astype(np.float64) * rays.reshape(-1, 3)[rows]
    for image in sorted(images, key=lambda i: float(np.linalg.norm(i.camera.position - at))):
        shown = image.shows_points(points)
        found.ravel()[rows[shown]] = True
        rows, points = rows[~shown], points[~shown]
        if not len(rows):
            break
    return found


def _is_dense(model: SubmapModel, camera: Camera, backend: Backend) -> Mask:
    """(H, W) bool: where the Gaussians are dense, and thin on screen: their shortest axis, divided by their distance
    and averaged by their weight, is small."""
    everywhere = tiles_of(np.ones((camera.intrinsics.height, camera.intrinsics.width), bool))
    g = gray_gaussians(model.gaussians, neighbor_groups(model.gaussians).rows(camera, everywhere))
    away = np.maximum(np.linalg.norm(g.means - camera.position, axis=1), 1e-3)
    thickness = np.minimum(np.exp(g.log_scales.min(axis=1)) / away, 1)
    sh = ((thickness - 0.5) / _CONSTANT)[:, None, None].repeat(3, axis=2).astype(np.float32)
    bare = replace(model, gaussians=replace(g, sh=sh), background=None, texture=None, appearance=None)
    view = render_model(bare, camera, backend=backend)
    assert view.rgb is not None and view.alpha is not None
    return np.asarray((view.alpha >= _SOLID) & (view.rgb[..., 0] < _THICK * view.alpha))


def share_of_sphere(directions: Mask) -> float:
    """The share of the sphere, 0 to 1, of the True pixels of six faces (6, S, S)."""
    offsets = (np.arange(directions.shape[-1]) + 0.5) / directions.shape[-1] * 2 - 1
    weight = (1 + offsets**2 + offsets[:, None] ** 2) ** -1.5  # solid angle of a pixel
    return float((directions.mean(axis=0) * weight).sum() / weight.sum())


def along_rays(directions: Mask, rays: NDArray[np.floating]) -> Mask:
    """(...) bool: the values of six faces (6, S, S) along `rays` (..., 3) in the world, of any length."""
    side = directions.shape[-1]
    axes = np.stack([camera.rotation for camera in cube(np.zeros(3), side)])  # (6, 3, 3), columns right, down, ahead
    local = np.einsum("...i,fij->...fj", rays, axes)
    face = local[..., 2].argmax(axis=-1)
    right, down, ahead = np.moveaxis(np.take_along_axis(local, face[..., None, None], axis=-2)[..., 0, :], -1, 0)
    column, row = (np.clip(np.floor((v / ahead + 1) / 2 * side), 0, side - 1).astype(np.int64) for v in (right, down))
    return np.asarray(directions[face, row, column])
