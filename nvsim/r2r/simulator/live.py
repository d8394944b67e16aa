"""Draws views live from the trained models of a project, with the method that draws its strips."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.mapping.climbing import TraversedFloor
from nvsim.project.floor_heights import floor_of
from nvsim.project.graph import thresholds_of
from nvsim.project.project import Project
from nvsim.project.stages.mapped import SceneViews, scan_name
from nvsim.project.work import lacks
from nvsim.r2r.observations.floor_distance import distances
from nvsim.r2r.observations.skybox import UNITS_A_METRE
from nvsim.r2r.simulator.errors import InvalidValue
from nvsim.r2r.simulator.images import Drawn, Goal, View
from nvsim.r2r.simulator.nav_graph import GraphOfProject, Scans
from nvsim.r2r.simulator.places_seen import PlacesSeen
from nvsim.r2r.simulator.scan import Scan
from nvsim.r2r.simulator.standing import Standing


class ProjectImages:
    """The models, the floor and the graph of a project, which is opened, read and closed.

    Raises InvalidValue if the project has no graph, or `drawing` is true and no model is trained.
    """

    one_thread_each = False  # the rasterizer is multi-threaded

    def __init__(self, root: Path, drawing: bool = True) -> None:
        try:
            with Project.open(root) as project:
                self._graph = GraphOfProject(project.need_graph(), scan_name(project))
                self._config = thresholds_of(project)
                self._scene, self._support = project.scene(), project.support()
                if drawing and (self._scene is None or self._support is None):
                    raise lacks(project.layout.root, "train")
                self._floor = floor_of(project)
                self._traversed: TraversedFloor | None = None
                if self._scene is not None:
                    capture = project.need_capture()
                    self._traversed = TraversedFloor(capture.positions, capture.is_scanned)
        except InputError as error:
            raise InvalidValue(str(error)) from error
        self._ground: Standing | None = None
        self._seen = PlacesSeen()

    def scans(self) -> Scans:
        return self._graph

    def preload(self, scans: Scans, depth: bool) -> None:
        """Loads the models, as far as the memory limit allows."""
        assert self._scene is not None
        for index in self._scene.indices:
            self._scene.model(index)

    def close(self) -> None:
        self._scene = self._support = self._ground = None
        self._seen.clear()

    # Drawing ------------------------------------------------------------------------------------------------------

    def draw(self, scan: Scan, index: int, heading: float, elevation: float, view: View) -> Drawn:
        return self.draw_from(scan.position[index].astype(np.float64), heading, elevation, view)

    def draw_from(self, position: NDArray[np.float64], heading: float, elevation: float, view: View) -> Drawn:
        """See Images: the view from a position (3,), meters, world."""
        if self._scene is None:
            raise InvalidValue("The simulator draws no images; call setRenderingEnabled(True) before initialize.")
        focal = view.height / 2 / np.tan(view.vfov / 2)
        intrinsics = Intrinsics(view.width, view.height, focal, focal, view.width / 2, view.height / 2)
        camera = Camera(intrinsics, look(position, heading, elevation))
        try:
            model = self._scene.model_at(camera.position)[1]
            colour, solid = self._seen.image(model, camera, view.depth)
        except InputError as error:
            raise InvalidValue(str(error)) from error
        rgb = (colour[..., ::-1] + np.float32(0.5)).astype(np.uint8)
        if not view.depth:
            return rgb, None
        along = camera.rays() @ camera.rotation[:, 2].astype(np.float32)
        metres = distances(solid, camera, model.floor) * along
        depth = np.minimum(metres * UNITS_A_METRE + np.float32(0.5), 65535)
        return rgb, depth.astype(np.uint16)[..., None]

    def stand(self, here: NDArray[np.float64], goal: Goal) -> NDArray[np.float64]:
        """See Images: the camera position (3,), meters, after a move from `here` (3,)."""
        return self._standing().stand(here, goal)

    def reachable(self, place: NDArray[np.float64], scan: Scan) -> list[int]:
        """See Images: the viewpoints with a free way from a position (3,), meters."""
        return self._standing().reachable(place, scan)

    def _standing(self) -> Standing:
        if self._scene is None or self._support is None:
            raise InvalidValue("The project has no trained models, so free space is unknown; run `nvsim train` on it.")
        if self._ground is None:
            assert self._traversed is not None
            views = SceneViews(self._scene, self._config)
            self._ground = Standing(views, self._floor, self._support.at, self._config, self._traversed)
        return self._ground
