"""Provides views of the trained models of a project to the map builder."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.directions import Sphere
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.families import NETWORK_NORMAL
from nvsim.perception.normals_network import NormalsNetwork, installed_normals
from nvsim.render.backends import Backend
from nvsim.render.types import RenderOutput
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import Gaussians, SubmapModel


class SceneViews:
    """Renders views of the scene model for the map builder, with the channels that the criteria of `config` need."""

    def __init__(self, scene: SceneModel, config: MappingConfig, backend: Backend = "auto") -> None:
        self._scene, self._backend, self._normals_model = scene, backend, config.normals_model
        also = (("depth", "depth"), (NETWORK_NORMAL, "rgb"))
        self._channels = frozenset({"alpha", "normal", *(channel for name, channel in also if name in config.criteria)})

    def views(
        self, position: NDArray[np.floating], cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> tuple[int, list[RenderOutput]]:
        """The submap nearest to `position` (3,), and one view per camera, rendered in its mask (H, W) bool."""
        index, model = self._scene.model_at(position)
        return index, self._rendered(model, cameras, masks)

    def another(self, position: NDArray[np.floating]) -> int | None:
        """A second submap that was trained on the frame nearest to `position` (3,), see SceneModel.second."""
        return self._scene.second(position)

    def trained_at(self, submap: int, positions: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(N,) bool: whether a submap was trained on the frame nearest to each of `positions` (N, 3), in meters."""
        return self._scene.trained_at(submap, positions)

    def views_of(
        self, submap: int, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> list[RenderOutput]:
        """One view per camera from the model of one submap, rendered in its mask (H, W) bool."""
        return self._rendered(self._scene.model(submap), cameras, masks)

    def panorama(self, sphere: Sphere, mask: NDArray[np.bool_], submap: int | None = None) -> tuple[int, RenderOutput]:
        """The submap nearest to the sphere, or `submap`, and its equirectangular image rendered in `mask` (H, W)
        bool."""
        from nvsim.render.panorama import render_equirectangular

        index, model = self._scene.model_at(sphere.position) if submap is None else (submap, self._scene.model(submap))
        size = sphere.width, sphere.height
        channels, heading = self._channels, sphere.heading
        return index, render_equirectangular(model, sphere.position, *size, channels, heading, self._backend, mask)

    @cached_property
    def surface_normals(self) -> NormalsNetwork:
        """The normals network that the criteria use. Raises InputError if none is installed."""
        return installed_normals(self._normals_model)

    def gaussians(self, submap: int) -> Gaussians:
        """The Gaussians of a submap's model."""
        return self._scene.model(submap).gaussians

    def _rendered(
        self, model: SubmapModel, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> list[RenderOutput]:
        from nvsim.render.regions import render_regions

        return render_regions(model, cameras, masks, self._channels, self._backend)
