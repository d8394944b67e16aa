"""Render the views that corridors are read from: one for each lattice direction, pitched down at the floor, or one
panorama of the viewpoint (paper section III-D).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import Sphere
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DIRECTIONS, Corridor, HeightAt, headings
from nvsim.mapping.families import NETWORK_NORMAL
from nvsim.mapping.views.floor_pixels import Eye
from nvsim.mapping.views.floor_view import FloorView, pixels_read
from nvsim.perception.roles import SurfaceNormals
from nvsim.render.backends import RenderOutput
from nvsim.splats.types import Gaussians


class ViewSource(Protocol):
    """A source of rendered views, such as the ensemble of submap models."""

    def views(
        self,
        position: NDArray[np.floating],
        cameras: Sequence[Camera],
        masks: Sequence[NDArray[np.bool_]],
    ) -> tuple[int, list[RenderOutput]]:
        """Return the submap that renders `position` (3,), meters, and a view for every camera. Views have alpha and
        normals, depth if the criterion depth is used, and colors if a network needs them. A view must be valid where
        its mask (H, W) is true."""
        ...


@runtime_checkable
class PanoramaSource(ViewSource, Protocol):
    """A source that can also render panoramas."""

    def panorama(self, sphere: Sphere, mask: NDArray[np.bool_], submap: int | None = None) -> tuple[int, RenderOutput]:
        """Render one equirectangular image (H, W) as `views` does. Its depth is the distance along the ray, and it must
        be valid where `mask` (H, W) is true. `submap` selects the model."""
        ...


@runtime_checkable
class NormalsSource(Protocol):
    """A source with a network that predicts normals from the colors of its views."""

    @property
    def surface_normals(self) -> SurfaceNormals:
        """The network. Raises InputError if none is installed."""
        ...


@runtime_checkable
class MultiModelSource(ViewSource, Protocol):
    """A source of which single models can be used, for second opinions and for the slice."""

    def second_submap(self, position: NDArray[np.floating]) -> int | None:
        """Return the nearest other submap that was also trained at `position` (3,), meters, besides the one that
        renders it. None if there is none."""
        ...

    def trained_at(self, submap: int, positions: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return (N,) bool: whether the model of a submap was trained at `positions` (N, 3), meters."""
        ...

    def views_of(
        self, submap: int, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> list[RenderOutput]:
        """Render views as `views` does, from the model of one submap; masks are (H, W)."""
        ...

    def gaussians(self, submap: int) -> Gaussians:
        """The Gaussians of a submap's model."""
        ...


_PITCH = -np.pi / 4
# From 5 degrees behind straight down to 5 degrees above the horizon, so that a corridor between two directions fits
# into either view.
_FOV = np.radians(100.0)


def camera_towards(position: NDArray[np.floating], heading: float, config: MappingConfig) -> Camera:
    """Return the camera at `position` (3,), meters, that sees from slightly behind straight down to slightly above the
    horizon. Its image contains every cell of a corridor within 22.5 degrees of `heading` (radians)."""
    x, y, z = (float(v) for v in position)
    return _camera((x, y, z), float(heading), config.view_size)


@lru_cache(maxsize=16)
def _camera(place: tuple[float, float, float], heading: float, size: int) -> Camera:
    return Camera(Intrinsics.from_fov(size, size, _FOV), camera_pose(np.array(place), heading, _PITCH))


def render_pitched_views(
    source: ViewSource,
    position: NDArray[np.floating],
    wanted: Mapping[int, Sequence[Corridor]],
    floor_at: HeightAt,
    config: MappingConfig,
    submap: int | None = None,
) -> dict[int, FloorView]:
    """Return the view from which the corridors of each lattice direction in `wanted` are read; a panorama serves all
    directions. The views are rendered from `position` (3,), meters.

    Only pixels that are read are rendered, unless a network needs whole views. `submap` selects the model of one
    submap; `source` must then be an Ensemble.
    """
    if config.views == "panorama":
        view = _panorama(source, position, wanted, floor_at, config, submap)
        return dict.fromkeys(range(DIRECTIONS), view)
    towards = headings(config)
    cameras = [camera_towards(position, towards[k], config) for k in wanted]
    masks = [pixels_read(c, corridors, floor_at) for c, corridors in zip(cameras, wanted.values(), strict=True)]
    if NETWORK_NORMAL in config.criteria:
        masks = [np.ones_like(mask) for mask in masks]
    if submap is None:
        submap, outputs = source.views(np.asarray(position, np.float64), cameras, masks)
    else:
        assert isinstance(source, MultiModelSource)
        outputs = source.views_of(submap, cameras, masks)
    found = zip(wanted, cameras, outputs, masks, strict=True)
    return {k: _floor_view(source, submap, camera, output, mask, config) for k, camera, output, mask in found}


def _panorama(
    source: ViewSource,
    position: NDArray[np.floating],
    wanted: Mapping[int, Sequence[Corridor]],
    floor_at: HeightAt,
    config: MappingConfig,
    submap: int | None,
) -> FloorView:
    if not isinstance(source, PanoramaSource):
        raise ValueError("the source renders no panoramas")
    sphere = Sphere(np.asarray(position, np.float64), config.panorama_width, config.panorama_width // 2)
    mask = pixels_read(sphere, [c for corridors in wanted.values() for c in corridors], floor_at)
    if NETWORK_NORMAL in config.criteria:
        mask = np.ones_like(mask)
    submap, output = source.panorama(sphere, mask, submap)
    return _floor_view(source, submap, sphere, output, mask, config)


def _floor_view(
    source: ViewSource, submap: int, eye: Eye, output: RenderOutput, mask: NDArray[np.bool_], config: MappingConfig
) -> FloorView:
    if output.alpha is None or output.normal is None:
        raise ValueError("the source rendered no alpha or no normal")
    normal_z = np.ascontiguousarray(output.normal[..., 2])
    depth = None if output.depth is None else output.alpha * output.depth
    network_z = _network_z(source, eye, output) if NETWORK_NORMAL in config.criteria else None
    return FloorView(submap, eye, output.alpha, normal_z, mask, depth, network_z)


def _network_z(source: ViewSource, eye: Eye, output: RenderOutput) -> NDArray[np.float32]:
    """(H, W) world z of the normals that a network predicts for a rendered view.

    A panorama is passed to the network unchanged, as in the paper. At every column, the network's frame is that of a
    level camera with that heading, and the upward component does not depend on the heading.
    """
    if output.rgb is None or not isinstance(source, NormalsSource):
        raise ValueError("the source has no network of normals, or rendered no colors for it")
    image = np.round(np.clip(output.rgb, 0.0, 1.0) * 255).astype(np.uint8)
    if isinstance(eye, Sphere):
        eye = Camera(Intrinsics.from_fov(eye.width, eye.height, np.pi / 2), camera_pose(eye.position, eye.heading))
    return np.ascontiguousarray(source.surface_normals.normals(image, eye)[..., 2])
