"""Draws views live from the trained models of a project, and decides to which positions an agent can move there.

The views are drawn with the method that draws the strips. The decisions are those of the map builder: corridors are
measured in the models, and compared with the thresholds of the project's map.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.floor_surface import Floor
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import Lattice, SupportAt
from nvsim.mapping.criteria import DECISIONS, OPEN, can_stand, decide, floor_below
from nvsim.mapping.evidence.measuring import Measurements
from nvsim.mapping.evidence.traversed_floor import TraversedFloor
from nvsim.mapping.views.view_sources import ViewSource
from nvsim.project.scene_views import LiveScene
from nvsim.r2r.observations.incremental_surround import PlacesSeen
from nvsim.r2r.observations.skybox import UNITS_A_METER, distances
from nvsim.r2r.simulator.conventions import InvalidValue
from nvsim.r2r.simulator.images import Goal, ViewSize
from nvsim.r2r.simulator.scan import OneScan, Scan, Scans, level_scan

if TYPE_CHECKING:
    from nvsim.r2r.simulator.images import Drawn

_LOW, _HIGH = 0.1, 3.0  # allowed camera heights above the floor in meters
_MOST = 500  # largest number of positions with cached measurements


def scan_of_graph(graph: NavGraph, id: str) -> Scan:
    """Returns a graph as a scan. All viewpoints are level and face +y."""
    viewpoints = list(graph.viewpoints.values())
    index = {v.id: i for i, v in enumerate(viewpoints)}
    edges = np.array([(index[a], index[b]) for a, b in graph.edges], np.int64).reshape(-1, 2)
    positions = np.array([v.position for v in viewpoints]).reshape(-1, 3)
    included = np.array([v.included for v in viewpoints], bool)
    return level_scan(id, list(index), included, positions, edges)


class FreeSpaceChecks:
    """Free-space checks in a project. Calls from several threads are serialized."""

    def __init__(
        self, source: ViewSource, floor: Floor, support: SupportAt, config: MappingConfig, traversed: TraversedFloor
    ) -> None:
        """`traversed` is the capture's trajectory, see `Measurements`."""
        self._source, self._floor, self._support, self._config = source, floor, support, config
        self._traversed = traversed
        self._lock = threading.Lock()
        self._reset()

    def position_after_move(self, here: NDArray[np.float64], goal: Goal) -> NDArray[np.float64]:
        """Returns the camera position (3,), meters, world, after a move from `here` (3,) to `goal`.

        Raises InvalidValue with the reason if the position, or a straight way that is required, is not free.
        """
        with self._lock:
            if len(self._places) > _MOST:
                self._reset()
            x, y = goal.x, goal.y
            above = here[2] - float(self._floor.height_at(here))
            there = np.array([x, y, here[2] if goal.z is None else goal.z], np.float64)
            if not np.isfinite(there).all():
                raise InvalidValue(f"{there.tolist()} is not a position; give finite meters.")
            if goal.z is None:
                there[2] = float(self._floor.height_at(there)) + above
            start, end = self._viewpoint(here), self._viewpoint(there)
            if not _LOW <= end.height <= _HIGH:
                raise InvalidValue(
                    f"An agent cannot stand at {_words(there)}: it is {end.height:.2f} m above the floor; give a "
                    f"height from {_LOW} to {_HIGH} m above it."
                )
            why = self._not_free(start, end) if goal.straight else self._not_standing(end)
            if why:
                way = f"go straight from {_words(here)} to" if goal.straight else "stand at"
                raise InvalidValue(f"An agent cannot {way} {_words(there)}: {why}.")
            return there

    def reachable(self, place: NDArray[np.float64], scan: Scan) -> list[int]:
        """Returns the indices of included viewpoints to which the way from a position (3,), meters, is free.

        Only viewpoints within the map builder's largest step are tested.
        """
        with self._lock:
            start = self._viewpoint(place)
            apart = np.linalg.norm(scan.position - place, axis=1)
            near = np.flatnonzero(scan.included & (apart <= self._config.tau_dist)).tolist()
            ends = {i: self._viewpoint(scan.position[i].astype(np.float64)) for i in near}
            return [
                i for i, end in ends.items() if apart[i] < 1e-3 or not self._reason_blocked(start, end, ends.values())
            ]

    def _not_standing(self, end: Viewpoint) -> str:
        around = self._measurements.around(end)
        if can_stand(around, self._config):
            return ""
        if floor_below(around, self._config)[1] < self._config.support:
            return "no image and no scan shows the floor there"
        return "there is an obstacle"

    def _not_free(self, start: Viewpoint, end: Viewpoint) -> str:
        """Tests the straight way in parts that are no longer than the map builder's largest step."""
        a, b = np.array(start.position), np.array(end.position)
        length = float(np.linalg.norm((b - a)[:2]))
        legs = max(1, int(np.ceil(length / self._config.tau_dist)))
        stops = [start, *(self._viewpoint(a + (b - a) * k / legs) for k in range(1, legs)), end]
        for one, other in zip(stops, stops[1:]):
            if one.position[:2] != other.position[:2] and (why := self._reason_blocked(one, other)):
                return why
        return ""

    def _reason_blocked(self, one: Viewpoint, other: Viewpoint, also: Iterable[Viewpoint] = ()) -> str:
        decision = decide(self._measurements.corridor_evidence(one, other, also), self._config)
        return "" if decision == OPEN else DECISIONS[decision].clause

    def _viewpoint(self, place: NDArray[np.float64]) -> Viewpoint:
        x, y, z = (float(value) for value in place)
        id = f"{x!r} {y!r} {z!r}"
        if id not in self._places:
            self._places.add(id)
            self._lattice.begin(id, (x, y))
        return Viewpoint(id, (x, y, z), z - float(self._floor.height_at(place)))

    def _reset(self) -> None:
        self._places: set[str] = set()
        self._lattice = Lattice(self._config)
        floor = self._floor.height_at
        self._measurements = Measurements(
            self._source, floor, self._support, self._config, self._lattice, traversed=self._traversed
        )


def _words(place: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in place) + ")"


class LiveImages:
    """Views from the trained models of a project.

    scans   its graph as the only scan
    """

    one_thread_each = False  # the rasterizer is multi-threaded

    def __init__(self, live: LiveScene) -> None:
        self._live = live
        self.scans: Scans = OneScan(scan_of_graph(live.graph, live.scan))
        self._ground: FreeSpaceChecks | None = None
        self._seen = PlacesSeen()

    def preload(self, scans: Scans, depth: bool) -> None:
        """Loads the models, as far as the memory limit allows."""
        scene = self._live.scene
        assert scene is not None
        for index in scene.indices:
            scene.model(index)

    def close(self) -> None:
        self._live, self._ground = replace(self._live, scene=None, support=None, views=None), None
        self._seen.clear()

    # Drawing ------------------------------------------------------------------------------------------------------

    def draw(self, scan: Scan, index: int, heading: float, elevation: float, view: ViewSize) -> Drawn:
        return self.draw_from(scan.position[index].astype(np.float64), heading, elevation, view)

    def draw_from(self, position: NDArray[np.float64], heading: float, elevation: float, view: ViewSize) -> Drawn:
        """See Images: the view from a position (3,), meters, world."""
        scene = self._live.scene
        if scene is None:
            raise InvalidValue("The simulator draws no images; call setRenderingEnabled(True) before initialize.")
        focal = view.height / 2 / np.tan(view.vfov / 2)
        intrinsics = Intrinsics(view.width, view.height, focal, focal, view.width / 2, view.height / 2)
        camera = Camera(intrinsics, camera_pose(position, heading, elevation))
        try:
            model = scene.model_at(camera.position)[1]
            color, solid = self._seen.image(model, camera, view.depth)
        except InputError as error:
            raise InvalidValue(str(error)) from error
        rgb = (color[..., ::-1] + np.float32(0.5)).astype(np.uint8)
        if not view.depth:
            return rgb, None
        along = camera.rays() @ camera.rotation[:, 2].astype(np.float32)
        meters = distances(solid, camera, model.floor) * along
        depth = np.minimum(meters * UNITS_A_METER + np.float32(0.5), 65535)
        return rgb, depth.astype(np.uint16)[..., None]

    def position_after_move(self, here: NDArray[np.float64], goal: Goal) -> NDArray[np.float64]:
        """See Images: the camera position (3,), meters, after a move from `here` (3,)."""
        return self._free_space_checks().position_after_move(here, goal)

    def reachable(self, place: NDArray[np.float64], scan: Scan) -> list[int]:
        """See Images: the viewpoints with a free way from a position (3,), meters."""
        return self._free_space_checks().reachable(place, scan)

    def _free_space_checks(self) -> FreeSpaceChecks:
        live = self._live
        if live.views is None or live.support is None or live.traversed is None:
            raise InvalidValue("The project has no trained models, so free space is unknown; run `nvsim train` on it.")
        if self._ground is None:
            self._ground = FreeSpaceChecks(
                live.views, live.floor, live.support.is_supported, live.config, live.traversed
            )
        return self._ground
