"""Instructions for tasks: as rough as they may be, so that a follower still finds the path."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from random import Random

from nvsim.graph.types import NavGraph
from nvsim.graph.ways import Ways
from nvsim.r2r.instructions.following import follow
from nvsim.r2r.instructions.ground import Ground, Leg
from nvsim.r2r.instructions.rounding import DETAILS, Detail, rounded
from nvsim.r2r.instructions.wording import instruction_of
from nvsim.r2r.tasks.retelling import retold
from nvsim.r2r.tasks.splitting import Dataset


@dataclass(frozen=True, eq=False)
class Told:
    """dataset   with the instructions of all tasks
    found     path_id -> how fine its instructions had to be, of those paths that the follower finds again
    """

    dataset: Dataset
    found: Mapping[int, Detail]

    @property
    def paths(self) -> int:
        return sum(map(len, self.dataset.splits.values()))


def instruct(dataset: Dataset, graphs: Iterable[NavGraph], each: int, seed: int) -> Told:
    """Gives every task `each` instructions: the same facts in other words. They depend on the graph, the task's path,
    heading and id, and the seed alone. Joined paths have those of their two."""
    grounds = {graph.scan: Ground(Ways.of(graph)) for graph in graphs}
    found: dict[int, Detail] = {}
    told: dict[int, tuple[str, ...]] = {}
    for task in (task for tasks in dataset.splits.values() for task in tasks):
        ground = grounds[task.scan]
        said, detail, again = say(ground, [ground.row[id] for id in task.path], task.heading)
        if again:
            found[task.path_id] = detail
        random = Random(f"{seed} {task.scan} {task.path_id}")
        told[task.path_id] = tuple(instruction_of(said, detail, random) for _ in range(each))
    return Told(retold(dataset, told), found)


def say(ground: Ground, path: list[int], heading: float) -> tuple[list[Leg], Detail, bool]:
    """What is said of a path (by rows of Ways) to one who looks to `heading` at its start: its legs in the roughest
    detail from which the follower finds it again, how rough that is, and whether it does; the finest where it does
    not."""
    legs = ground.legs(path, heading)
    for detail in DETAILS:
        said = rounded(legs, detail)
        if follow(ground, path[0], heading, said) == path:
            return said, detail, True
    return said, detail, False
