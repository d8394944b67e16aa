"""Generates instructions for tasks, as coarse as a follower needs to find the path.

The follower knows the graph, the start, the first heading, and the instruction, not the path.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from random import Random

from nvsim.events import Listener, Progress, silent
from nvsim.graph.types import NavGraph
from nvsim.graph.ways import Ways
from nvsim.r2r.instructions.cues import chosen_cues, drop_redundant_cues
from nvsim.r2r.instructions.ground import DETAILS, Detail, Ground, Leg, Step, goes_on, rounded, turned, wrapped
from nvsim.r2r.instructions.wording import instruction_of
from nvsim.r2r.surroundings.survey import Surroundings
from nvsim.r2r.tasks.splitting import Dataset, replace_instructions

_METRE = 0.5  # distance error in meters that costs 1 (squared)
_ANGLE = math.radians(22.5)  # turn error in radians that costs 1 (squared)
_FARTHEST_TURN = math.radians(60)  # largest turn error
_UNSEEN = 2.0  # cost of a mentioned cue that is missing
_LONGEST = 15.0  # largest length in meters of a leg without a stated distance
_ALIKE = 1e-9
_MOST_TRIED = 200_000  # largest number of steps tried
STAGE = "instructions"
_WITHOUT = 0.6
"""Probability that the distance of a leg is omitted if a cue marks its end."""


def follow(ground: Ground, start: int, heading: float, said: Sequence[Leg]) -> list[int] | None:
    """Finds the path from row `start` with first heading `heading` (radians) that fits the legs best.

    The cost is the sum of the squared errors of turns and distances, plus a fixed cost for each missing cue. Slopes
    must match. Returns the rows of the path, or None if no path fits, two paths fit equally, or the search is too
    large.
    """
    search = _Search(ground, said)
    search.begin([start], heading, 0, 0.0)
    return None if search.tied or search.tried > _MOST_TRIED else search.best


class _Search:
    """Depth-first search over the legs in order. A branch ends if it costs more than the best path so far."""

    def __init__(self, ground: Ground, said: Sequence[Leg]) -> None:
        self.ground, self.said = ground, said
        self.best: list[int] | None = None
        self.least = math.inf
        self.tied = False
        self.tried = 0

    def begin(self, path: list[int], facing: float, k: int, cost: float) -> None:
        """Tries all first steps of the k-th leg."""
        said = self.said[k]
        for step in self._new_steps(path):
            off = wrapped(turned(facing, step) - said.turn)
            if step.slope == said.slope and abs(off) <= _FARTHEST_TURN:
                after = _facing(facing, step)
                self._walk([*path, step.to], len(path) - 1, after, k, step.metres, cost + (off / _ANGLE) ** 2)

    def _walk(self, path: list[int], first: int, facing: float, k: int, walked: float, cost: float) -> None:
        """Continues the k-th leg or ends it here. The leg began at path[first], `walked` meters before."""
        self.tried += 1
        said = self.said[k]
        slack = 0.0 if said.metres is None else 1.0 + 0.2 * said.metres
        least, most = (0.0, _LONGEST) if said.metres is None else (said.metres - slack, said.metres + slack)
        if walked > most or cost > self.least + _ALIKE or self.tried > _MOST_TRIED:
            return
        if walked >= least:
            here = cost if said.metres is None else cost + ((walked - said.metres) / _METRE) ** 2
            if said.cues and here <= self.least + _ALIKE:
                here += _UNSEEN * len(said.cues - self.ground.cues(path[first:]))
            if k + 1 < len(self.said):
                self.begin(path, facing, k + 1, here)
            else:
                self._end(path, here)
        for step in self._new_steps(path):
            if goes_on(said.slope, turned(facing, step), step):
                self._walk([*path, step.to], first, _facing(facing, step), k, walked + step.metres, cost)

    def _end(self, path: list[int], cost: float) -> None:
        if cost < self.least - _ALIKE:
            self.best, self.least, self.tied = path, cost, False
        elif cost <= self.least + _ALIKE and path != self.best:
            self.tied = True

    def _new_steps(self, path: list[int]) -> list[Step]:
        return [step for step in self.ground.steps[path[-1]] if step.to not in path]


def _facing(before: float, step: Step) -> float:
    return before if step.heading is None else step.heading


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
