"""Episodes of tasks in the simulator: an agent acts until it stops, and what it did is its trajectory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from nvsim.r2r.metrics.submission import Pose
from nvsim.r2r.simulator import SimState, Simulator
from nvsim.r2r.tasks.task import Task

Action = tuple[int, float, float]
"""Index of a navigable location, and turns to the right and up, of which the sign counts, as `makeAction` has it."""
_AT_ONCE = 64  # episodes


class Walk(Protocol):
    """An agent in one episode."""

    def act(self, state: SimState) -> Action | None:
        """What to do; None to stop. The state goes on with the episode: copy what is to be kept."""


class Agent(Protocol):
    """restricted   whether only viewpoints in the field of view can be gone to"""

    restricted: bool

    def begin(self, instr_id: str, task: Task) -> Walk: ...


def run_agent(agent: Agent, tasks: Sequence[Task], graphs: Path) -> dict[str, list[Pose]]:
    """The trajectory of every episode of `tasks`, by instr_id: in views of 640x480 pixels and 60 degrees, 30 degrees
    apart, as R2R's own agents have them, without images.

    graphs   the folder of scans.txt and the connectivity files
    """
    episodes = [(id, task) for task in tasks for id in task.instr_ids]
    found: dict[str, list[Pose]] = {}
    size = min(_AT_ONCE, len(episodes))
    sim = _simulator(graphs, max(size, 1), agent.restricted)
    for begin in range(0, len(episodes), _AT_ONCE):
        part = episodes[begin : begin + size]
        filled = [task for _, task in part + part[-1:] * (size - len(part))]  # a batch is always of the same size
        starts = [task.scan for task in filled], [task.path[0] for task in filled]
        sim.newEpisode(*starts, [task.heading for task in filled], [0.0] * size)
        found |= dict(zip((id for id, _ in part), _walked(sim, [agent.begin(*episode) for episode in part])))
    return found


def _walked(sim: Simulator, walks: Sequence[Walk]) -> list[list[Pose]]:
    trajectories = [[_pose(state)] for state in sim.getState()[: len(walks)]]
    going = set(range(len(walks)))
    while going:
        states = sim.getState()
        actions: list[Action] = [(0, 0.0, 0.0)] * len(states)
        for i in sorted(going):
            action = walks[i].act(states[i])
            if action is None:
                going.discard(i)
            else:
                actions[i] = action
        if going:
            sim.makeAction(*(list(values) for values in zip(*actions)))
        for i in going:
            trajectories[i].append(_pose(sim.getState()[i]))
    return trajectories


def _pose(state: SimState) -> Pose:
    return state.location.viewpointId, round(float(state.heading), 6), round(float(state.elevation), 6)


def _simulator(graphs: Path, size: int, restricted: bool) -> Simulator:
    sim = Simulator()
    sim.setNavGraphPath(graphs)
    sim.setRenderingEnabled(False)
    sim.setCameraResolution(640, 480)
    sim.setCameraVFOV(math.radians(60))
    sim.setDiscretizedViewingAngles(True)
    sim.setRestrictedNavigation(restricted)
    sim.setBatchSize(size)
    sim.initialize()
    return sim
