"""What an agent did with each instruction, with how well; also of a submission that holds only some of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.metrics.scores import score
from nvsim.r2r.metrics.submission import Pose, Trajectories
from nvsim.r2r.tasks.task import Task


@dataclass(frozen=True)
class Episode:
    """ne metres; success whether that is near; spl 0 to 1, as `nvsim evaluate r2r` counts them."""

    poses: tuple[Pose, ...]
    ne: float
    success: bool
    spl: float


def episodes(tasks: Iterable[Task], trajectories: Trajectories, distances: Distances) -> Mapping[str, Episode]:
    """instr_id -> its episode, of the tasks and trajectories that the graph of `distances` holds."""
    found: dict[str, Episode] = {}
    for task in tasks:
        for k, id in enumerate(task.instr_ids):
            poses = tuple(trajectories.get(id, ()))
            walked = [pose[0] for pose in poses]
            if len(task.path) < 2 or not poses or distances.wrong_step(task.path) or distances.wrong_step(walked):
                continue
            one = replace(task, instructions=task.instructions[k : k + 1])
            scores = score([one], {one.instr_ids[0]: poses}, {task.scan: distances})
            found[id] = Episode(poses, float(scores.ne[0]), bool(scores.success[0]), float(scores.spl[0]))
    return found
