"""A task together with the actions that follow its path."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.events import Listener, Progress, silent
from nvsim.graph.types import NavGraph
from nvsim.r2r.episodes.acting import TURN, FreeSpace, Walk, walk_along
from nvsim.r2r.surroundings.layers import Layers
from nvsim.r2r.tasks.task import Task

STAGE = "episodes"


@dataclass(frozen=True, eq=False)
class Episode:
    """A task as a continuous episode.

    path     (M, 3) meters, world: the floor under the task's viewpoints
    walk     the actions and the poses before them
    floors   (N,) meters, world z of the floor before each action
    """

    task: Task
    path: NDArray[np.float64]
    walk: Walk
    floors: NDArray[np.float64]


class Scene:
    """A scan in which robots move. Paths between storeys have no episodes."""

    def __init__(self, graph: NavGraph, storeys: Sequence[Layers], cloud: NDArray[np.floating] | None = None) -> None:
        """`cloud` is (N, 3), meters, world, or None; see `FreeSpace.of`."""
        self._graph = graph
        self._spaces: dict[str, FreeSpace] = {}
        for layers in storeys:
            space = FreeSpace.of(layers, graph, cloud)
            self._spaces |= {one.viewpoint.id: space for one in layers.seen}

    def climbs(self, task: Task) -> bool:
        """Returns True if the path uses stairs. Obstacles on stairs cannot be found in a level slice."""
        return len({self._spaces.get(id) for id in task.path}) > 1 or task.path[0] not in self._spaces

    def episode(self, task: Task, turn: int = TURN) -> Episode | None:
        """Returns the episode of a task with turns of `turn` degrees, or None if the robot has no room along the path
        or would have to climb."""
        if self.climbs(task):
            return None
        viewpoints = [self._graph.viewpoints[id] for id in task.path]
        space = self._spaces[task.path[0]]
        path = np.array([(*v.position[:2], v.position[2] - v.height) for v in viewpoints], np.float64)
        walk = walk_along(space, path, task.heading, turn)
        return None if walk is None else Episode(task, path, walk, _floors(path, walk.places))


def episodes_of(
    splits: Mapping[str, Iterable[Task]], scenes: Mapping[str, Scene], listen: Listener = silent, turn: int = TURN
) -> dict[str, list[Episode]]:
    """Returns split -> episodes with turns of `turn` degrees, without the tasks that have none; `scenes` is by scan."""
    all_tasks = [(name, task) for name, tasks in splits.items() for task in tasks]
    found: dict[str, list[Episode]] = {name: [] for name in splits}
    for i, (name, task) in enumerate(all_tasks):
        episode = scenes[task.scan].episode(task, turn)
        if episode is not None:
            found[name].append(episode)
        listen(Progress(STAGE, i + 1, len(all_tasks)))
    return found


def instruction_id(task: Task, number: int) -> int:
    """Returns the id of an instruction that is unique over all paths: 100 * path_id + number."""
    return 100 * task.path_id + number


def numbered(episodes: Sequence[Episode]) -> Iterator[tuple[int, Episode, str]]:
    """Yields (`instruction_id`, episode, text) for every instruction."""
    for episode in episodes:
        for k, text in enumerate(episode.task.instructions):
            yield instruction_id(episode.task, k), episode, text


def _floors(path: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns (N,) the height of the nearest point of the path, for places (N, 2)."""
    a, b = path[:-1], path[1:]
    along = b[:, :2] - a[:, :2]
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((places[:, None] - a[:, :2]) * along).sum(axis=2) / square, 0, 1)
    off = np.linalg.norm(a[:, :2] + share[..., None] * along - places[:, None], axis=2)
    best, rows = off.argmin(axis=1), np.arange(len(places))
    return np.asarray(a[best, 2] + share[rows, best] * (b[best, 2] - a[best, 2]))
