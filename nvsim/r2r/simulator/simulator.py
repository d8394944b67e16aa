"""Matterport3DSimulator in Python, with its calls and states but without C++ and OpenGL.

Source: github.com/peteanderson80/Matterport3DSimulator, whose messages are kept. This class covers two of its versions:
agents of the batched version call `initialize()` and give lists; agents of v0.1 call `init()` and give scalars.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from nvsim.geometry.directions import STEP
from nvsim.r2r.simulator.conventions import (
    InvalidValue,
    Minstd,
    NotStarted,
    Timers,
    WrongType,
    checked_counts,
    checked_names,
    checked_numbers,
)
from nvsim.r2r.simulator.images import Goal, Images, ViewSize, draw_all
from nvsim.r2r.simulator.scan import JoinedScans, Scans
from nvsim.r2r.simulator.settings import Settings, source_of
from nvsim.r2r.simulator.state import (
    TURN,
    Batch,
    OffGraphPosition,
    SimState,
    black_images,
    position_of,
    rounded_view_direction,
)

if TYPE_CHECKING:
    from nvsim.r2r.simulator.images import Drawn


class Simulator(Settings):
    """A batch of environments. Calls from several threads are serialized.

    Differences to Matterport3DSimulator: simulators of a process may have different graphs and datasets. An edited
    graph is used from the next episode on. A call that fails changes nothing. After `close()`, the simulator can be set
    up again.

    If `scans` is given, they replace the graphs of setNavGraphPath or of a project.
    """

    def __init__(self, scans: Scans | None = None) -> None:
        super().__init__()
        self._given = scans
        self._lock = threading.RLock()
        self._timers = Timers()
        self._batch: Batch | None = None
        self._states: list[SimState] = []
        self._scalar = False  # whether getState returns one state, as in v0.1
        self._scans: Scans | None = None
        self._images: Images | None = None

    # Opening and closing ------------------------------------------------------------------------------------------

    def initialize(self) -> None:
        """Opens graphs and images. Most settings cannot change after it.

        Raises InvalidValue if a project is unreadable, or, with preloading, if any image is.
        """
        with self._lock:
            self._view = ViewSize(self.width, self.height, self.vfov, self.depth_enabled)
            images = [black_images(self.width, self.height) for _ in range(self.batch_size)]
            scans, drawing = source_of(self)
            scans = scans if self._given is None else self._given
            if self.rendering_enabled and self.preloading:
                begin = time.perf_counter()
                drawing.preload(scans, self.depth_enabled)
                self._timers.preloading += time.perf_counter() - begin
            self._scans, self._images = scans, drawing
            self._random = Minstd(self.seed)
            self._batch = Batch(self.batch_size, [rgb for rgb, _ in images], [depth for _, depth in images])
            self._states = [SimState(self._batch, i) for i in range(self.batch_size)]
            self.initialized = True

    def init(self) -> None:
        """Calls `initialize`. After it, getState returns one state and all arguments are scalars, as in v0.1."""
        with self._lock:
            if self.batch_size != 1:
                raise WrongType("init() is v0.1's and has one environment; call initialize() for a batch.")
            self.initialize()
            self._scalar = True

    def close(self) -> None:
        """Releases graphs and images. States that were returned earlier stay valid."""
        with self._lock:
            if self._images is not None:
                self._images.close()
            self._scans = self._images = None
            self.initialized = False

    @property
    def scans(self) -> Scans:
        """The source of the scans. Raises NotStarted before `initialize`."""
        if self._scans is None:
            raise NotStarted("MatterSim: initialize must be called before the scans are known")
        return self._scans

    # Episodes -----------------------------------------------------------------------------------------------------

    def newEpisode(
        self,
        scanId: str | Sequence[str],
        viewpointId: str | Sequence[str],
        heading: float | Sequence[float],
        elevation: float | Sequence[float],
    ) -> None:
        """Begins an episode in each environment, at a viewpoint of a scan, with heading and elevation in radians.

        Scalars are allowed for one environment; then the viewpoint "" selects a random one.

        Raises UnknownScan (IndexError), InvalidValue (ValueError) if a viewpoint is missing or excluded or its images
        are unusable, BatchMismatch (IndexError) if a list is too short, WrongType (TypeError).
        """
        with self._lock, self._timers:
            scalar = isinstance(scanId, str)
            if scalar and (self.batch_size != 1 or self.batched):
                raise WrongType("After setBatchSize, newEpisode takes lists with one value for each environment.")
            size = self.batch_size
            ids, viewpoints = checked_names(scanId, size, "scanId"), checked_names(viewpointId, size, "viewpointId")
            headings, elevations = (
                checked_numbers(heading, size, "heading"),
                checked_numbers(elevation, size, "elevation"),
            )
            if not self.initialized:
                self.initialize()
            assert self._scans is not None and self._batch is not None
            found = {id: self._scans.scan(id) for id in dict.fromkeys(ids)}
            if scalar and not viewpoints[0]:
                viewpoints = [self._any_viewpoint(ids[0])]
            indices = [found[id].index(v) for id, v in zip(ids, viewpoints)]
            joined = self._batch.joined
            if joined is None or not joined.contains(found.values()):
                joined = JoinedScans({**({} if joined is None else joined.scans), **found}.values())
            places = [joined.first[id] + i for id, i in zip(ids, indices)]
            self._draw_and_update(joined, ids, places, headings, elevations, {}, [0] * size)
            self._scalar = scalar

    def newRandomEpisode(self, scanId: str | Sequence[str]) -> None:
        """Begins an episode at a random viewpoint of each scan, with a random heading and elevation 0.

        The first seed gives the episodes of Matterport3DSimulator.
        """
        with self._lock:
            scalar = isinstance(scanId, str)
            ids = [scanId] if isinstance(scanId, str) else list(scanId)
            if self._scans is None:
                self.initialize()
            directions = Minstd()
            viewpoints = [self._any_viewpoint(id) for id in ids]
            headings = [TURN * directions.random_float() for _ in ids]
            if scalar:
                self.newEpisode(ids[0], viewpoints[0], headings[0], 0.0)
            else:
                self.newEpisode(ids, viewpoints, headings, [0.0] * len(ids))

    def _any_viewpoint(self, id: str) -> str:
        assert self._scans is not None
        scan = self._scans.scan(id)
        if not scan.included.any():
            raise NotStarted(f"MatterSim: ScanId: {id} has no included viewpoints!")
        index = self._random.random_below(len(scan.ids))
        while not scan.included[index]:
            index = (index + 1) % len(scan.ids)
        return scan.ids[index]

    # Acting -------------------------------------------------------------------------------------------------------

    def getState(self) -> Any:
        """Returns the states of the batch, or one state if the arguments are scalars.

        The states change with the next action: copy the values that you keep.
        """
        return self._states[0] if self._scalar else self._states

    def makeAction(
        self,
        index: int | Sequence[int],
        heading: float | Sequence[float],
        elevation: float | Sequence[float],
    ) -> None:
        """Moves each environment to a navigable location, then turns it by a heading and an elevation in radians.

        If viewing angles are discrete, only the signs of the turns count.

        Raises NotStarted (RuntimeError) before the first episode, InvalidValue (ValueError) for an invalid index.
        """
        batch = self._batch
        if not self.initialized or batch is None:
            raise NotStarted("MatterSim: newEpisode must be called before makeAction")
        with self._lock:
            begin = time.perf_counter()
            if batch.act(index, heading, elevation, self.vfov * self.width / self.height):
                self._timers.add(begin)
                return
        with self._lock, self._timers:
            size = batch.size
            chosen = checked_counts(index, size, "index")
            headings, elevations = (
                checked_numbers(heading, size, "heading"),
                checked_numbers(elevation, size, "elevation"),
            )
            joined, places = batch.joined, batch.place.copy()
            for b, way in enumerate(chosen):
                if way or joined is None:
                    locations = batch.locations(b)
                    if way >= len(locations):
                        raise InvalidValue(
                            f"MatterSim: Invalid action index: {way} in environment {b} of {self.batch_size}"
                        )
                    assert joined is not None  # otherwise there are no locations
                    places[b] = joined.first[batch.scan[b]] + locations[way].ix
            assert joined is not None
            if self.discrete:
                headings = [STEP if h > 0 else -STEP if h < 0 else 0.0 for h in headings]
                elevations = [STEP if e > 0 else -STEP if e < 0 else 0.0 for e in elevations]
            headings = [before + change for before, change in zip(batch.heading, headings)]
            elevations = [before + change for before, change in zip(batch.elevation, elevations)]
            beside = {b: place for b, place in batch.beside.items() if not chosen[b]}
            self._draw_and_update(
                joined, batch.scan, places, headings, elevations, beside, [step + 1 for step in batch.step]
            )

    def move_to(
        self,
        x: float,
        y: float,
        z: float | None = None,
        heading: float | None = None,
        elevation: float | None = None,
        *,
        straight: bool = False,
        locations: bool = True,
        environment: int = 0,
    ) -> None:
        """Moves to any free position of a project, meters, world. Needs a project as dataset.

        z             height in meters; if None, the height above the floor is unchanged
        straight      whether the straight way must be free, or only the position itself
        locations     whether nearby viewpoints with a free way become navigable, in addition to the position itself
        environment   index in the batch

        Raises InvalidValue (ValueError) with the reason if the position or the way is not known to be free, NotStarted
        before `newEpisode`.
        """
        batch = self._batch
        if not self.initialized or batch is None or batch.joined is None or self._images is None:
            raise NotStarted("MatterSim: newEpisode must be called before move_to")
        if not 0 <= environment < batch.size:
            raise InvalidValue(f"There is no environment {environment} in a batch of {batch.size}.")
        with self._lock, self._timers:
            scan = batch.joined.scans[batch.scan[environment]]
            goal = Goal(float(x), float(y), None if z is None else float(z), straight)
            there = self._images.position_after_move(position_of(batch, environment), goal)
            near = self._images.reachable(there, scan) if locations else []
            rows = [batch.joined.first[scan.id] + i for i in near]
            headings, elevations, steps = batch.heading.copy(), batch.elevation.copy(), batch.step.copy()
            headings[environment] = headings[environment] if heading is None else float(heading)
            elevations[environment] = elevations[environment] if elevation is None else float(elevation)
            steps[environment] += 1
            beside = {**batch.beside, environment: OffGraphPosition.with_free_ways(there, rows, batch.joined)}
            self._draw_and_update(
                batch.joined, batch.scan, batch.place, headings, elevations, beside, steps, environment
            )

    def _draw_and_update(
        self,
        joined: JoinedScans,
        scans: list[str],
        places: list[int],
        headings: list[float],
        elevations: list[float],
        beside: dict[int, OffGraphPosition],
        steps: list[int],
        alone: int | None = None,
    ) -> None:
        """Draws the images and then updates the environments; with `alone`, draws only that environment."""
        batch = self._batch
        assert batch is not None
        limits = self.lowest, self.highest
        headings, elevations, view = rounded_view_direction(headings, elevations, self.discrete, *limits, batch.view)
        if self.rendering_enabled:
            images, size = self._images, self._view
            assert images is not None

            def draw(b: int) -> Drawn:
                if b in beside:
                    return images.draw_from(beside[b].position, headings[b], elevations[b], size)
                return images.draw(joined.scans[scans[b]], joined.indices[places[b]], headings[b], elevations[b], size)

            wanted = range(batch.size) if alone is None else range(alone, alone + 1)
            begin = time.perf_counter()
            drawn = draw_all(images, [partial(draw, b) for b in wanted])
            self._timers.rendering += time.perf_counter() - begin
            self._timers.frames += len(wanted)
            for b, (rgb, depth) in zip(wanted, drawn):
                batch.rgb[b] = rgb
                if depth is not None:
                    batch.depth[b] = depth
        batch.joined, batch.scan, batch.place, batch.beside = joined, scans, places, beside
        batch.heading, batch.elevation, batch.view, batch.step = headings, elevations, view, steps
        widest = math.cos(self.vfov * self.width / self.height / 2.0) if self.restricted else None
        batch.look_around(self.discrete, widest)
        quick = self.discrete and not self.rendering_enabled
        batch.quick_angle = self.vfov * self.width / self.height if quick else None

    # Timing -------------------------------------------------------------------------------------------------------

    def resetTimers(self) -> None:
        """Sets the times of all parts to zero."""
        self._timers.reset()

    def timingInfo(self) -> str:
        """Returns the times of all parts as lines of text."""
        return str(self._timers)
