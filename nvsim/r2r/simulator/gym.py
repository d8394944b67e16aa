"""The simulator as Gymnasium environments. Importing this module registers both; it needs the package gymnasium.

`nvsim/Graph-v0` moves from viewpoint to viewpoint. `nvsim/Walk-v0` moves in small steps through free space. An episode
leads from a start to a goal in a scan. The reward of an action is the decrease of the remaining path to the goal in
meters. Stopping within `NEAR` of the goal, R2R's measure of success, adds `BONUS`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from nvsim.errors import InputError
from nvsim.r2r.simulator.conventions import InvalidValue
from nvsim.r2r.simulator.scan import Scan
from nvsim.r2r.simulator.simulator import Simulator

try:
    import gymnasium
    from gymnasium import spaces
except ImportError as error:
    raise InputError("The environments need the package gymnasium; install nvsim[gym].") from error

NEAR = 3.0
"""Meters."""
BONUS = 1.0
STOP = 0
Observation = dict[str, NDArray[Any]]


class EpisodeEnv(gymnasium.Env[Observation, np.int64], ABC):
    """An environment with observations `rgb`, `goal`, and those that a subclass adds.

    `rgb` is (height, width, 3) uint8, if there are images. `goal` is (2,) float32: the straight distance in meters, and
    the direction in radians to the right of the heading.

    dataset         a project, or the folder of skyboxes
    graphs          the folder of connectivity files; None for the project's own graph
    scans           ids of the scans from which episodes are drawn; empty for all
    width, height   pixels
    vfov            vertical field of view in radians
    images          if false, no image dataset is needed and observations have no `rgb`
    least           smallest length in meters of the shortest path, if the scan has such a path

    `reset` has the options scan, viewpoint, heading and goal (a viewpoint). Raises InputError if there is no scan, and
    the errors of the simulator.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        dataset: str | Path = "./data/v1/scans",
        graphs: str | Path | None = None,
        scans: tuple[str, ...] = (),
        width: int = 320,
        height: int = 240,
        vfov: float = math.radians(60),
        images: bool = True,
        least: float = 5.0,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode, self._images, self._least = render_mode, images, least
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"There is no render mode {render_mode!r}; use rgb_array.")
        sim = Simulator()
        sim.setDatasetPath(dataset)
        if graphs is not None:
            sim.setNavGraphPath(graphs)
        sim.setRenderingEnabled(images)
        sim.setCameraResolution(width, height)
        sim.setCameraVFOV(vfov)
        sim.setRestrictedNavigation(False)
        sim.initialize()
        self.simulator, self._scans = sim, scans or sim.scans.scan_ids()
        if not self._scans:
            raise InputError("There is no scan for episodes; export one, or name another folder.")
        parts: dict[str, spaces.Space[Any]] = {"goal": spaces.Box(-np.inf, np.inf, (2,), np.float32)}
        if images:
            parts["rgb"] = spaces.Box(0, 255, (height, width, 3), np.uint8)
        self._parts = parts

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode and returns observation and info. Raises InputError if no viewpoint is included."""
        super().reset(seed=seed)
        chosen = options or {}
        id = chosen.get("scan") or self._scans[int(self.np_random.integers(len(self._scans)))]
        self._scan = scan = self.simulator.scans.scan(id)
        usable = np.flatnonzero(scan.included)
        if not len(usable):
            raise InputError(f"The scan {id} has no included viewpoint; choose another scan.")
        goal = chosen.get("goal")
        self._goal = scan.index(goal) if goal else int(self.np_random.choice(usable))
        self._ways = _ways_to(scan, self._goal)
        start = chosen.get("viewpoint")
        if not start:
            reach = np.where(np.isfinite(self._ways[usable]), self._ways[usable], -1)
            far = usable[reach >= min(self._least, float(reach.max()))]
            start = scan.ids[int(self.np_random.choice(far))]
        heading = chosen.get("heading", self.np_random.uniform(0, 2 * math.pi))
        self.simulator.newEpisode([id], [start], [heading], [0.0])
        self._left = self._way_left()
        return self._observation(), self._info()

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        if int(action) == STOP:
            near = self._left < NEAR
            return self._observation(), BONUS if near else 0.0, True, False, self._info() | {"success": near}
        more = self._act(int(action))
        left, before = self._way_left(), self._left
        self._left = left
        gained = before - left if math.isfinite(before) and math.isfinite(left) else 0.0
        return self._observation(), gained, False, False, self._info() | more

    def render(self) -> Any:
        """Returns (height, width, 3) uint8 RGB, or None without a render mode."""
        return None if self.render_mode is None else self._rgb()

    def close(self) -> None:
        self.simulator.close()

    # Overridden by the environments ------------------------------------------------------------------------------

    @abstractmethod
    def _act(self, action: int) -> dict[str, Any]:
        """Executes an action and returns additional entries of `info`."""

    def _observation(self) -> Observation:
        state = self.state
        offset = self._scan.position[self._goal].astype(float) - np.array(state.location.point)
        turn = math.remainder(math.atan2(offset[0], offset[1]) - state.heading, 2 * math.pi)
        found: Observation = {"goal": np.array([np.linalg.norm(offset), turn], np.float32)}
        return found | {"rgb": self._rgb()} if self._images else found

    def _info(self) -> dict[str, Any]:
        place = self.state.location
        return {"scan": self._scan.id, "viewpoint": place.viewpointId, "position": place.point, "way_left": self._left}

    # ---------------------------------------------------------------------------------------------------------------

    @property
    def state(self) -> Any:
        """The state of the simulator's only environment."""
        return self.simulator.getState()[0]

    def _rgb(self) -> NDArray[np.uint8]:
        return np.ascontiguousarray(self.state.rgb[..., ::-1])

    def _way_left(self) -> float:
        """Meters to the goal: to the current or nearest viewpoint, and from there along the graph."""
        offset = np.linalg.norm(self._scan.position - np.array(self.state.location.point, np.float32), axis=1)
        offset[~self._scan.included] = np.inf
        nearest = int(np.argmin(offset))
        return float(offset[nearest] + self._ways[nearest])


def _ways_to(scan: Scan, goal: int) -> NDArray[np.float64]:
    """Returns (n,) meters of the shortest path from each viewpoint to the goal; inf if there is none."""
    count = len(scan.ids)
    graph = csr_array((scan.reach[:, 0], scan.neighbor, scan.starts), shape=(count, count))
    return np.asarray(dijkstra(graph.T.tocsr(), indices=goal))


class GraphEnv(EpisodeEnv):
    """Action 0 stops. Action k moves to the k-th navigable location, sorted by the angle from the image center.

    The agent then faces the direction of the move. An action without a location changes nothing.

    Observations also have `candidates` (most, 3) float32: radians to the right, radians up, and meters; unused rows are
    0. `info["action_mask"]` (most + 1,) int8 marks the available actions. most: largest number of neighbors.
    """

    def __init__(self, *arguments: Any, most: int = 15, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._most = most
        self.action_space = spaces.Discrete(most + 1)
        candidates = spaces.Box(-np.inf, np.inf, (most, 3), np.float32)
        self.observation_space = cast(spaces.Space[Observation], spaces.Dict({**self._parts, "candidates": candidates}))

    def _act(self, action: int) -> dict[str, Any]:
        locations = self.state.navigableLocations
        if action >= min(len(locations), self._most + 1):
            return {"invalid": True}
        turn = locations[action].rel_heading
        self.simulator.makeAction([action], [turn], [0.0])
        return {"invalid": False}

    def _observation(self) -> Observation:
        found = np.zeros((self._most, 3), np.float32)
        for row, place in zip(found, self.state.navigableLocations[1:]):
            row[:] = place.rel_heading, place.rel_elevation, place.rel_distance
        return super()._observation() | {"candidates": found}

    def _info(self) -> dict[str, Any]:
        mask = np.arange(self._most + 1) < len(self.state.navigableLocations)
        return super()._info() | {"action_mask": mask.astype(np.int8)}


class WalkEnv(EpisodeEnv):
    """Actions: 0 stops, 1 moves ahead by `forward` meters, 2 and 3 turn left and right by `turn` degrees.

    A step outside known free space does not move the agent, and `info["refused"]` has the reason. `dataset` is a
    project.
    """

    def __init__(
        self,
        dataset: str | Path = "project.nvsim",
        *arguments: Any,
        forward: float = 0.25,
        turn: float = 15.0,
        **named: Any,
    ) -> None:
        super().__init__(dataset, *arguments, **named)
        self._forward, self._turn = forward, math.radians(turn)
        self.action_space = spaces.Discrete(4)
        self.observation_space = cast(spaces.Space[Observation], spaces.Dict(self._parts))

    def _act(self, action: int) -> dict[str, Any]:
        if action > 1:
            self.simulator.makeAction([0], [self._turn if action == 3 else -self._turn], [0.0])
            return {"refused": ""}
        state = self.state
        x = state.location.x + self._forward * math.sin(state.heading)
        y = state.location.y + self._forward * math.cos(state.heading)
        try:
            self.simulator.move_to(x, y, straight=True, locations=False)
        except InvalidValue as refusal:
            return {"refused": str(refusal)}
        return {"refused": ""}


gymnasium.register("nvsim/Graph-v0", GraphEnv, max_episode_steps=30)
gymnasium.register("nvsim/Walk-v0", WalkEnv, max_episode_steps=500)
