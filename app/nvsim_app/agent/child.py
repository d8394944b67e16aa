"""The child process of the agent: a simulator computes states immediately, and a thread renders the newest state.
Does not use Qt.

The simulator compiles kernels and loads models, so it runs outside the window's process, which must not wait.
"""

from __future__ import annotations

import threading
import traceback
from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.directions import HEIGHT, VFOV, WIDTH
from nvsim_app.agent.state import AgentState, Location, Pose, Walk, WalkedGraph
from nvsim_app.processes.serving import Requests, WindowClosed, short_reason

if TYPE_CHECKING:
    from nvsim.r2r.simulator import SimState, Simulator, ViewPoint
    from nvsim.r2r.simulator.images import Images
    from nvsim.r2r.simulator.scan import Scan

_KEPT = 48  # images, 0.9 MB each


@dataclass(frozen=True)
class AgentSource:
    """The source of an agent's graph and images.

    project   the project whose models render the images
    file      the connectivity file, if no project is open
    images    the folder of images beside `file`, if there is one
    lacking   why no images are available, "" if there may be some
    """

    project: Path | None = None
    file: Path | None = None
    images: Path | None = None
    lacking: str = ""


@dataclass(frozen=True, eq=False)
class WalkRequest:
    """A walk to replay. graph: the graph of this walk and of later ones, None if the graph has not changed."""

    number: int
    walk: Walk
    graph: WalkedGraph | None = None


@dataclass(frozen=True, eq=False)
class WalkState:
    """The state after a walk, and the poses of the walk from the start on."""

    number: int
    state: AgentState
    trajectory: tuple[Pose, ...]


@dataclass(frozen=True)
class RefusedStep:
    """The graph does not allow the step at index `at`, or the start of the walk if `at` is -1."""

    number: int
    at: int
    why: str


@dataclass(frozen=True, eq=False)
class StateImage:
    """The image of a state, or the reason why there is none.

    pixels   (480, 640, 3) uint8 in the order blue, green, red; None if there is no image
    why      why there is no image
    trace    the traceback if rendering failed unexpectedly
    """

    number: int
    pixels: NDArray[np.uint8] | None
    why: str = ""
    trace: str = ""


def serve(requests: Requests, source: AgentSource) -> None:
    """Answers WalkRequests until the window closes. A walk that is possible gets Walked, then Seen. Other walks get
    Refused."""
    ground = _WindowSimulator(source)
    drawing = _StateRenderer(source, requests)
    while True:
        number, request = requests.wait_for_request()
        assert isinstance(request, WalkRequest)
        if request.graph is not None:
            ground.walk_on(request.graph)
        try:
            state, trajectory = ground.state_after(request.walk)
        except _StepNotPossible as step:
            requests.answer(number, RefusedStep(request.number, step.at, str(step)))
            continue
        requests.answer(number, WalkState(request.number, _values(state), trajectory), more=True)
        drawing.render_state(number, request.number, ground.scan, state)


class _StepNotPossible(Exception):
    def __init__(self, at: int, why: str) -> None:
        super().__init__(why)
        self.at = at


class _WindowSimulator:
    """The simulator on the window's current graph."""

    def __init__(self, source: AgentSource) -> None:
        import nvsim.r2r.simulator  # noqa: F401  # loads the kernels before the first request

        self._source = source
        self._name = _scan_name(source)
        self._rotations: dict[str, NDArray[np.float64]] = {}
        if source.file is not None:
            self._rotations = _rotations(source.file, self._name)
        self.scan: Scan

    def walk_on(self, graph: WalkedGraph) -> None:
        from nvsim.r2r.simulator.scan import level_scan

        level = level_scan(self._name, graph.ids, graph.included, graph.positions, graph.edges)
        turned = [self._rotations.get(id, rotation) for id, rotation in zip(graph.ids, level.rotation, strict=True)]
        self.scan = replace(level, rotation=np.array(turned).reshape(-1, 3, 3))

    def state_after(self, walk: Walk) -> tuple[SimState, tuple[Pose, ...]]:
        """The state after a walk. Raises _Impossible."""
        simulator = self._simulator(walk.restricted)
        start = walk.start
        try:
            simulator.newEpisode(self.scan.id, start.viewpoint, start.heading, start.elevation)
        except InputError as error:
            raise _StepNotPossible(-1, str(error)) from error
        state: SimState = simulator.getState()
        trajectory = [_pose(state)]
        for at, step in enumerate(walk.steps):
            index = 0
            if step.to:
                ids = [place.viewpointId for place in state.navigableLocations]
                if step.to not in ids[1:]:
                    raise _StepNotPossible(at, f"{step.to} is not navigable from {state.location.viewpointId}.")
                index = ids.index(step.to, 1)
            simulator.makeAction(index, float(step.heading), float(step.elevation))
            trajectory.append(_pose(state))
        return state, tuple(trajectory)

    def _simulator(self, restricted: bool) -> Simulator:
        """A simulator with the settings of R2R agents, without rendering, so that a replay does not wait for images."""
        from nvsim.r2r.simulator import Simulator
        from nvsim.r2r.simulator.scan import OneScan

        made = Simulator(OneScan(self.scan))
        made.setCameraResolution(WIDTH, HEIGHT)
        made.setCameraVFOV(VFOV)
        made.setDiscretizedViewingAngles(True)
        made.setRestrictedNavigation(restricted)
        made.setRenderingEnabled(False)
        return made


class _StateRenderer:
    """Renders the newest state in a thread, and skips states that became outdated meanwhile."""

    def __init__(self, source: AgentSource, requests: Requests) -> None:
        self._source, self._requests = source, requests
        self._images: Images | None = None
        self._drawn: OrderedDict[tuple[object, ...], NDArray[np.uint8]] = OrderedDict()
        self._wanted: tuple[int, int, Scan, int, float, float] | None = None
        self._wake = threading.Condition()
        threading.Thread(target=self._run, name="drawing", daemon=True).start()

    def render_state(self, request: int, number: int, scan: Scan, state: SimState) -> None:
        """Renders a state. `request` is the number for the answer, and `number` is that of the walk."""
        with self._wake:
            self._wanted = request, number, scan, state.location.ix, state.heading, state.elevation
            self._wake.notify()

    def _run(self) -> None:
        while True:
            with self._wake:
                while self._wanted is None:
                    self._wake.wait()
                (request, number, scan, index, heading, elevation), self._wanted = self._wanted, None
            try:
                seen = StateImage(number, self._draw(scan, index, heading, elevation))
            except InputError as error:
                seen = StateImage(number, None, str(error))
            except Exception as error:
                seen = StateImage(
                    number, None, f"The view could not be rendered: {short_reason(error)}", traceback.format_exc()
                )
            try:
                self._requests.answer(request, seen)
            except WindowClosed:
                return

    def _draw(self, scan: Scan, index: int, heading: float, elevation: float) -> NDArray[np.uint8]:
        from nvsim.r2r.simulator.images import ViewSize

        if self._source.lacking:
            raise InputError(self._source.lacking)
        key = (scan.ids[index], *scan.position[index].tolist(), heading, elevation)
        found = self._drawn.get(key)
        if found is None:
            if self._images is None:
                self._images = _images_of(self._source)
            if self._source.images is not None:
                scan = replace(scan, id=self._source.images.parent.name)  # StripImages looks for a folder of this name
            found, _ = self._images.draw(scan, index, heading, elevation, ViewSize(WIDTH, HEIGHT, VFOV, False))
        self._drawn[key] = found
        self._drawn.move_to_end(key)
        while len(self._drawn) > _KEPT:
            self._drawn.popitem(last=False)
        return found


def _images_of(source: AgentSource) -> Images:
    """The images of a source. Raises InputError if it has none."""
    from nvsim.r2r.simulator.images import StripImages

    if source.project is not None:
        from nvsim.project.scene_views import read_live_scene
        from nvsim.r2r.simulator.live import LiveImages

        return LiveImages(read_live_scene(source.project))
    if source.images is None:
        raise InputError("There are no images to render from.")
    return StripImages(source.images.parent.parent, 16)


def _scan_name(source: AgentSource) -> str:
    if source.file is not None:
        from nvsim.graph.connectivity import SUFFIX

        return source.file.name.removesuffix(SUFFIX) if source.file.name.endswith(SUFFIX) else source.file.stem
    if source.project is None:
        return "scan"
    from nvsim.project.project import Project

    try:
        with Project.open(source.project) as project:
            return project.scan_name
    except InputError:
        return source.project.stem  # the graph can still be walked


def _rotations(file: Path, name: str) -> dict[str, NDArray[np.float64]]:
    """Viewpoint id -> (3, 3) camera-to-world rotation of its pose; empty if the simulator cannot read the file."""
    from nvsim.r2r.simulator.scan import read_scan

    try:
        scan = read_scan(file, name)
    except InputError:
        return {}
    return dict(zip(scan.ids, scan.rotation, strict=True))


def _pose(state: SimState) -> Pose:
    return Pose(state.location.viewpointId, state.heading, state.elevation)


def _values(state: SimState) -> AgentState:
    locations = tuple(_location(place) for place in state.navigableLocations)
    return AgentState(
        state.scanId,
        state.step,
        _location(state.location),
        state.heading,
        state.elevation,
        state.viewIndex,
        locations,
    )


def _location(place: ViewPoint) -> Location:
    relative = place.rel_heading, place.rel_elevation, place.rel_distance
    return Location(place.viewpointId, place.ix, place.x, place.y, place.z, *relative)
