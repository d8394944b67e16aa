"""Provides views of the trained models of a project, to the map builder and to the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.directions import Sphere
from nvsim.geometry.floor_surface import Floor
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.evidence.traversed_floor import TraversedFloor
from nvsim.mapping.families import NETWORK_NORMAL
from nvsim.perception.normals_network import NormalsNetwork, installed_normals
from nvsim.perception.stacked_support import StackedSupport
from nvsim.perception.support import FloorSupport
from nvsim.project.floor_heights import floor_of
from nvsim.project.graph import thresholds_of
from nvsim.project.project import Project
from nvsim.project.work import missing_result_error
from nvsim.render.backends import Backend, RenderOutput
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
        return index, self._render_views(model, cameras, masks)

    def second_submap(self, position: NDArray[np.floating]) -> int | None:
        """A second submap that was trained on the frame nearest to `position` (3,), see SceneModel.second."""
        return self._scene.second(position)

    def trained_at(self, submap: int, positions: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(N,) bool: whether a submap was trained on the frame nearest to each of `positions` (N, 3), in meters."""
        return self._scene.trained_at(submap, positions)

    def views_of(
        self, submap: int, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> list[RenderOutput]:
        """One view per camera from the model of one submap, rendered in its mask (H, W) bool."""
        return self._render_views(self._scene.model(submap), cameras, masks)

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

    def _render_views(
        self, model: SubmapModel, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> list[RenderOutput]:
        from nvsim.render.scene import render_regions

        return render_regions(model, cameras, masks, self._channels, self._backend)


@dataclass(frozen=True, eq=False)
class LiveScene:
    """The models, the floor and the graph of a project.

    scan       the scan id of the graph
    config     the thresholds of the map
    scene      the trained models; None without models, and then `views` and `traversed` too
    support    the known floor, None without models
    views      the views of the models for the map builder
    traversed  the trajectory of the capture
    """

    graph: NavGraph
    scan: str
    config: MappingConfig
    floor: Floor
    scene: SceneModel | None
    support: FloorSupport | StackedSupport | None
    views: SceneViews | None
    traversed: TraversedFloor | None


def read_live_scene(root: Path, drawing: bool = True) -> LiveScene:
    """Opens, reads and closes a project.

    Raises InputError if it has no graph, or `drawing` is true and no model is trained.
    """
    with Project.open(root) as project:
        graph, scan, config = project.need_graph(), project.scan_name, thresholds_of(project)
        scene, support = project.scene(), project.support()
        if drawing and (scene is None or support is None):
            raise missing_result_error(project.layout.root, "train")
        floor = floor_of(project)
        if scene is None:
            return LiveScene(graph, scan, config, floor, None, support, None, None)
        capture = project.need_capture()
        traversed = TraversedFloor(capture.positions, not capture.trajectory_counts)
        return LiveScene(graph, scan, config, floor, scene, support, SceneViews(scene, config), traversed)
