"""Generates instructions for tasks, as coarse as a follower needs to find the path."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from random import Random

from nvsim.events import Listener, Progress, silent
from nvsim.graph.types import NavGraph
from nvsim.graph.ways import Ways
from nvsim.r2r.instructions.choosing import chosen_cues, drop_redundant_cues
from nvsim.r2r.instructions.following import follow
from nvsim.r2r.instructions.ground import Ground, Leg
from nvsim.r2r.instructions.rounding import DETAILS, Detail, rounded
from nvsim.r2r.instructions.wording import instruction_of
from nvsim.r2r.surroundings.survey import Surroundings
from nvsim.r2r.tasks.retelling import replace_instructions
from nvsim.r2r.tasks.splitting import Dataset

STAGE = "instructions"
_WITHOUT = 0.6
"""Probability that the distance of a leg is omitted if a cue marks its end."""


@dataclass(frozen=True, eq=False)
class InstructedDataset:
    """A dataset with instructions.

    dataset   all tasks with their instructions
    found     path_id -> the detail its instructions need, for paths that the follower finds from every instruction
    """

    dataset: Dataset
    found: Mapping[int, Detail]

    @property
    def paths(self) -> int:
        return sum(map(len, self.dataset.splits.values()))


def instruct(
    dataset: Dataset,
    graphs: Iterable[NavGraph],
    each: int,
    seed: int,
    seen: Mapping[str, Surroundings] | None = None,
    listen: Listener = silent,
) -> InstructedDataset:
    """Gives every task `each` instructions with different words and cues.

    The result depends only on the graph, its surroundings (`seen`, by scan), the task's path, heading and id, and the
    seed. Joined paths get the instructions of their two parts.
    """
    grounds = {graph.scan: Ground(Ways.of(graph), (seen or {}).get(graph.scan)) for graph in graphs}
    found: dict[int, Detail] = {}
    texts_by_path: dict[int, tuple[str, ...]] = {}
    tasks = [task for tasks in dataset.splits.values() for task in tasks]
    for task in tasks:
        ground = grounds[task.scan]
        rows = [ground.row[id] for id in task.path]
        random = Random(f"{seed} {task.scan} {task.path_id}")
        plain = say(ground, rows, task.heading)
        texts, details = [], []
        for _ in range(each):
            said, detail, again = _with_cues(ground, rows, task.heading, random) or plain
            texts.append(instruction_of(said, detail, random))
            details += [detail] if again else []
        if len(details) == each and (each or plain[2]):
            found[task.path_id] = max([*details, DETAILS[0]] if each else [plain[1]], key=DETAILS.index)
        texts_by_path[task.path_id] = tuple(texts)
        listen(Progress(STAGE, len(texts_by_path), len(tasks)))
    return InstructedDataset(replace_instructions(dataset, texts_by_path), found)


def _with_cues(
    ground: Ground, path: list[int], heading: float, random: Random
) -> tuple[list[Leg], Detail, bool] | None:
    """Describes a path with some of its cues, and without distances that the follower does not need.

    Returns the legs, the detail, and True. Returns None if the path has no cues or the follower does not find it.
    """
    legs = [replace(leg, cues=chosen_cues(leg.cues, random)) for leg in ground.legs(path, heading)]
    if not any(leg.cues for leg in legs):
        return None
    fewer = [replace(leg, metres=None) if _ends_by_sight(leg) and random.random() < _WITHOUT else leg for leg in legs]
    tries: list[tuple[list[Leg], Detail]] = [(legs, detail) for detail in DETAILS]
    if fewer != legs:
        tries.insert(0, (fewer, "words"))
    for some, detail in tries:
        said = rounded(some, detail)
        if follow(ground, path[0], heading, said) == path:
            return said, detail, True
    return None


def _ends_by_sight(leg: Leg) -> bool:
    """Whether a cue marks the end of the leg."""
    return any(cue.kind in ("by", "into", "through", "stairs", "to stairs") for cue in leg.cues)


def say(ground: Ground, path: list[int], heading: float) -> tuple[list[Leg], Detail, bool]:
    """Describes a path (rows of Ways) that begins with heading `heading` (radians).

    Returns the legs in the coarsest detail from which the follower finds the path, that detail, and True. If no detail
    is enough, returns the finest one and False.
    """
    legs = [replace(leg, cues=drop_redundant_cues(leg.cues)) for leg in ground.legs(path, heading)]
    for detail in DETAILS:
        said = rounded(legs, detail)
        if follow(ground, path[0], heading, said) == path:
            return said, detail, True
    return said, detail, False
