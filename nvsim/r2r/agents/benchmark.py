"""A benchmark, and the loop that runs agents through its episodes in the simulator and records their trajectories.

A benchmark is a tasks file together with the scans that its tasks use, read and checked against each other.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from nvsim.errors import InputError
from nvsim.graph.connectivity import read_connectivity, scan_files
from nvsim.graph.types import NavGraph
from nvsim.r2r.metrics.distances import Distances, check_tasks
from nvsim.r2r.metrics.submission import Pose
from nvsim.r2r.simulator import SimState, Simulator
from nvsim.r2r.tasks.task import Task, read_tasks

Action = tuple[int, float, float]
"""Index of a navigable location, heading change, and elevation change. Only the signs of the changes count, as in
`makeAction`; positive is right and up."""
_AT_ONCE = 64  # episodes
_WAIT: Action = (0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Benchmark:
    """A set of tasks and the graphs of their scans.

    folder   contains scans.txt and the connectivity files
    graphs   scan id -> graph, for every scan that has a task
    """

    folder: Path
    tasks: Sequence[Task]
    graphs: Mapping[str, NavGraph]

    @staticmethod
    def read(scans: Path, tasks: Path) -> Benchmark:
        """Reads a scans folder and a tasks file.

        Raises InputError if a file is unreadable, there are no tasks, or a path is not in its graph.
        """
        found = read_tasks(tasks)
        if not found:
            raise InputError(f"{tasks} has no paths; export tasks again with paths in this split.")
        files = scan_files(scans, list(dict.fromkeys(task.scan for task in found)))
        graphs = {scan: read_connectivity(path) for scan, path in files.items()}
        benchmark = Benchmark(next(iter(files.values())).parent, found, graphs)
        check_tasks(found, benchmark.distances, tasks)
        return benchmark

    @cached_property
    def distances(self) -> Mapping[str, Distances]:
        """scan id -> distances in meters between the viewpoints of the scan"""
        return {scan: Distances(graph) for scan, graph in self.graphs.items()}


def scans_in(folder: Path) -> Path:
    """Returns the folder of an export's scans: the folder itself, or its folder `scans`."""
    inside = folder / "scans"
    return inside if (inside / "connectivity").is_dir() else folder


def tasks_in(folder: Path, split: str) -> Path:
    """Returns the task file of a split in an export. Raises InputError if it is missing."""
    path = folder / "tasks" / f"R2R_{split}.json"
    if not os.path.lexists(path):
        scans = scans_in(folder)
        raise InputError(
            f"{path} does not exist; write it with `nvsim export tasks --scans {scans} --out {path.parent}`, or give "
            "--tasks."
        )
    return path


@dataclass(frozen=True)
class Agent:
    """An agent that runs in the simulator.

    restricted   if true, the agent can only move to viewpoints in the field of view
    episode      yields the actions of an episode from its instr_id, its task, and the state of its environment, which
                 changes after each action; the agent stops after the last action
    """

    restricted: bool
    episode: Callable[[str, Task, SimState], Iterator[Action]]


def run_agent(agent: Agent, tasks: Sequence[Task], graphs: Path) -> dict[str, list[Pose]]:
    """Runs every episode of `tasks` and returns the trajectories by instr_id.

    Views have 640x480 pixels and 60 degrees and are 30 degrees apart, as in R2R's own agents. No images are rendered.

    graphs   the folder with scans.txt and the connectivity files
    """
    episodes = [(id, task) for task in tasks for id in task.instr_ids]
    found: dict[str, list[Pose]] = {}
    size = min(_AT_ONCE, len(episodes))
    sim = _simulator(graphs, max(size, 1), agent.restricted)
    for begin in range(0, len(episodes), _AT_ONCE):
        part = episodes[begin : begin + size]
        filled = [task for _, task in part + part[-1:] * (size - len(part))]  # pads the last batch to the full size
        starts = [task.scan for task in filled], [task.path[0] for task in filled]
        sim.newEpisode(*starts, [task.heading for task in filled], [0.0] * size)
        found |= dict(zip((id for id, _ in part), _run_episodes(sim, agent, part)))
    return found


def _run_episodes(sim: Simulator, agent: Agent, part: Sequence[tuple[str, Task]]) -> list[list[Pose]]:
    states = sim.getState()[: len(part)]
    episodes = [agent.episode(id, task, state) for (id, task), state in zip(part, states)]
    trajectories = [[_pose(state)] for state in states]
    actions = {i: next(episode, None) for i, episode in enumerate(episodes)}
    while going := {i: action for i, action in actions.items() if action is not None}:
        sim.makeAction(*(list(values) for values in zip(*(going.get(b, _WAIT) for b in range(sim.batch_size)))))
        for i in going:
            trajectories[i].append(_pose(states[i]))
        actions = {i: next(episodes[i], None) for i in going}
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
