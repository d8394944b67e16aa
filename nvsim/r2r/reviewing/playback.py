"""An agent's trajectory and scores for each instruction, also for an incomplete submission."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.metrics.scores import score
from nvsim.r2r.metrics.submission import Pose, Trajectories
from nvsim.r2r.tasks.task import Task


@dataclass(frozen=True)
class Episode:
    """A trajectory and its scores as in `nvsim evaluate r2r`: ne in meters, success, spl from 0 to 1."""

    poses: tuple[Pose, ...]
    ne: float
    success: bool
    spl: float


def episodes(tasks: Iterable[Task], trajectories: Trajectories, distances: Distances) -> Mapping[str, Episode]:
    """Returns instr_id -> episode, for tasks and trajectories that fit the graph of `distances`."""
    ids: list[str] = []
    alone: list[Task] = []  # tasks with one instruction each and new path_ids
    walks: dict[str, tuple[Pose, ...]] = {}
    for task in tasks:
        if len(task.path) < 2 or distances.wrong_step(task.path):
            continue
        for id in task.instr_ids:
            poses = tuple(trajectories.get(id, ()))
            if poses and not distances.wrong_step([pose[0] for pose in poses]):
                alone.append(Task(len(ids), "", task.path, task.heading))
                walks[alone[-1].instr_ids[0]] = poses
                ids.append(id)
    if not ids:
        return {}
    scores = score(alone, walks, {"": distances})
    figures = zip(walks.values(), scores.ne.tolist(), scores.success.tolist(), scores.spl.tolist())
    return {id: Episode(poses, ne, bool(success), spl) for id, (poses, ne, success, spl) in zip(ids, figures)}
