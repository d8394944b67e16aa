"""Generates instructions for tasks, as coarse as a follower needs to find the path.

The follower knows the graph, the start, the first heading, and the instruction, not the path.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from random import Random

from nvsim.events import Listener, Progress, ignore_event
from nvsim.graph.paths import PathGraph
from nvsim.graph.types import NavGraph
from nvsim.r2r.instructions import Register
from nvsim.r2r.instructions.cues import ENDS, choose_cues, choose_few_cues, drop_redundant_cues, may_mean_the_same
from nvsim.r2r.instructions.ground import (
    DETAILS,
    Detail,
    Leg,
    Measure,
    PathSteps,
    Step,
    View,
    continues_leg,
    is_bend,
    round_legs,
    turn_before_step,
    wrap_angle,
)
from nvsim.r2r.instructions.short_wording import short_instruction
from nvsim.r2r.instructions.wording import instruction_of, long_instruction
from nvsim.r2r.surroundings.survey import Surroundings
from nvsim.r2r.tasks.splitting import Dataset, replace_instructions

_METER = 0.5  # distance error in meters that costs 1 (squared)
_ANGLE = math.radians(22.5)  # turn error in radians that costs 1 (squared)
_FARTHEST_TURN = math.radians(60)  # largest turn error
_BEND = math.radians(70)  # bend in radians that costs 1 (squared)
_ONWARD = 0.02  # cost of a meter of a leg without a stated distance
_UNSEEN = 2.0  # cost of a mentioned cue that is missing
_LONGEST = 15.0  # largest length in meters of a leg without a stated distance
_ALIKE = 1e-9
_MOST_TRIED = 200_000  # largest number of steps tried
STAGE = "instructions"
_AMOUNTS: tuple[tuple[int, Measure | None], ...] = (
    *((1, None), (1, None), (2, None), (1, "roughly"), (2, "roughly"), (2, "paces")),
    (3, "paces"),
)
"""Cues per leg and measures of the distance of the short register, from few facts to many."""
_WORDS = 15  # number of words of a short instruction that needs no shorter wording
_WITHOUT = 0.6
"""Probability that the distance of a leg is omitted if a cue marks its end."""


def find_described_path(ground: PathSteps, start: int, heading: float, said: Sequence[Leg]) -> list[int] | None:
    """Finds the path from row `start` with first heading `heading` (radians) that fits the legs best.

    The cost is the sum of the squared errors of turns and distances, plus a fixed cost for each missing cue. Slopes
    must match. Returns the rows of the path, or None if no path fits, two paths fit equally, or the search is too
    large.
    """
    search = _PathSearch(ground, said)
    search.begin([start], heading, 0, 0.0)
    return None if search.tied or search.tried > _MOST_TRIED else search.best


class _PathSearch:
    """Depth-first search over the legs in order. A branch ends if it costs more than the best path so far."""

    def __init__(self, ground: PathSteps, said: Sequence[Leg]) -> None:
        self.ground, self.said = ground, said
        self.best: list[int] | None = None
        self.least = math.inf
        self.tied = False
        self.tried = 0

    def begin(self, path: list[int], facing: float, k: int, cost: float) -> None:
        """Tries all first steps of the k-th leg."""
        said = self.said[k]
        for step in self._new_steps(path):
            off = wrap_angle(turn_before_step(facing, step) - said.turn)
            if step.slope == said.slope and abs(off) <= _FARTHEST_TURN:
                after = _heading_after(facing, step)
                self._continue_leg([*path, step.to], len(path) - 1, after, k, step.meters, cost + (off / _ANGLE) ** 2)

    def _continue_leg(self, path: list[int], first: int, facing: float, k: int, walked: float, cost: float) -> None:
        """Continues the k-th leg or ends it here. The leg began at path[first], `walked` meters before."""
        self.tried += 1
        said = self.said[k]
        least, most, unit = _length_range(said)
        if walked > most or cost > self.least + _ALIKE or self.tried > _MOST_TRIED:
            return
        if walked >= least:
            here = cost if said.meters is None else cost + ((walked - said.meters) / unit) ** 2
            if said.meters is None and (said.cues or k + 1 < len(self.said)):
                here += _ONWARD * walked  # the leg ends at the first place that fits
            if said.cues and here <= self.least + _ALIKE:
                here += _UNSEEN * len(said.cues - self.ground.cues(path[first:]))
            if k + 1 < len(self.said):
                self.begin(path, facing, k + 1, here)
            else:
                self._end(path, here)
        for step in self._new_steps(path):
            turn, after = turn_before_step(facing, step), _heading_after(facing, step)
            if continues_leg(said.slope, turn, step):
                self._continue_leg([*path, step.to], first, after, k, walked + step.meters, cost)
            elif is_bend(said.slope, turn, step):
                self._continue_leg([*path, step.to], first, after, k, walked + step.meters, cost + (turn / _BEND) ** 2)

    def _end(self, path: list[int], cost: float) -> None:
        if cost < self.least - _ALIKE:
            self.best, self.least, self.tied = path, cost, False
        elif cost <= self.least + _ALIKE and path != self.best:
            self.tied = True

    def _new_steps(self, path: list[int]) -> list[Step]:
        return [step for step in self.ground.steps[path[-1]] if step.to not in path]


def _length_range(said: Leg) -> tuple[float, float, float]:
    """Returns the least and the greatest length of a leg in meters, and the error in meters that costs 1."""
    if said.meters is None:
        return 0.0, _LONGEST, _METER
    rough = said.measure == "roughly"
    slack = 0.7 * said.meters if rough else 1.0 + 0.2 * said.meters
    return said.meters - slack, said.meters + slack, max(_METER, 0.5 * said.meters) if rough else _METER


def _heading_after(before: float, step: Step) -> float:
    return before if step.heading is None else step.heading


@dataclass(frozen=True, eq=False)
class InstructedDataset:
    """A dataset with instructions.

    dataset   all tasks with their instructions
    found     path_id -> the detail its instructions need, for paths that the follower finds from every instruction
    places    path_id -> for each instruction, the index in the path of the viewpoint that each word describes; only of
              the register rxr
    """

    dataset: Dataset
    found: Mapping[int, Detail]
    places: Mapping[int, tuple[tuple[int, ...], ...]] = field(default_factory=dict)

    @property
    def paths(self) -> int:
        return sum(map(len, self.dataset.splits.values()))


def instruct(
    dataset: Dataset,
    graphs: Iterable[NavGraph],
    each: int,
    seed: int,
    seen: Mapping[str, Surroundings] | None = None,
    listen: Listener = ignore_event,
    register: Register = "short",
) -> InstructedDataset:
    """Gives every task `each` instructions with different words and cues.

    The result depends only on the graph, its surroundings (`seen`, by scan), the task's path, heading and id, the seed,
    and the register. Joined paths get the instructions of their two parts.
    """
    grounds = {graph.scan: PathSteps(PathGraph.of(graph), (seen or {}).get(graph.scan)) for graph in graphs}
    found: dict[int, Detail] = {}
    texts_by_path: dict[int, tuple[str, ...]] = {}
    places: dict[int, tuple[tuple[int, ...], ...]] = {}
    tasks = [task for tasks in dataset.splits.values() for task in tasks]
    for task in tasks:
        ground = grounds[task.scan]
        rows = [ground.row[id] for id in task.path]
        random = Random(f"{seed} {task.scan} {task.path_id}")
        texts, details, described = [], [], []
        for _ in range(each):
            said, detail, again = _find_description(ground, rows, task.heading, register, random)
            text, words = _text(ground, said, task.heading, detail, register, random)
            texts.append(text)
            described.append(words)
            details += [detail] if again else []
        if not each:
            _, detail, again = describe_path(ground, rows, task.heading)
            details += [detail] if again else []
        if len(details) == max(1, each):
            found[task.path_id] = max(details, key=DETAILS.index)
        texts_by_path[task.path_id] = tuple(texts)
        if register == "rxr":
            places[task.path_id] = tuple(described)
        listen(Progress(STAGE, len(texts_by_path), len(tasks)))
    return InstructedDataset(replace_instructions(dataset, texts_by_path), found, places)


def _text(
    ground: PathSteps, said: Sequence[Leg], heading: float, detail: Detail, register: Register, random: Random
) -> tuple[str, tuple[int, ...]]:
    """Returns an instruction, and for each word the viewpoint of the path that it describes (only register rxr)."""
    if register == "short":
        return min((short_instruction(said, detail, random) for _ in range(9)), key=_count_excess_words), ()
    if register == "detailed":
        return instruction_of(said, detail, random), ()
    views = [ground.view(said[0].rows[0], heading)]
    for leg in said:
        ahead = ground.step(leg.rows[0], leg.rows[1]).heading
        views.append(View("") if ahead is None else ground.view(leg.rows[0], ahead))
    sentences = long_instruction(said, views, detail, random)
    return " ".join(text for text, _ in sentences), _places_of(sentences, said)


def _places_of(sentences: Sequence[tuple[str, int]], said: Sequence[Leg]) -> tuple[int, ...]:
    """Returns for each word the index of a viewpoint of the path: the words of a leg are spread over its viewpoints."""
    counts = [0] * (len(said) + 1)
    for text, number in sentences:
        counts[number] += len(text.split())
    begin, found = 0, []
    for leg, count in zip(said, counts):
        steps = len(leg.rows) - 1
        found += [begin + i * steps // count for i in range(count)]
        begin += steps
    return (*found, *[begin] * counts[-1])


def _count_excess_words(text: str) -> int:
    return max(0, len(text.split()) - _WORDS)


def _find_description(
    ground: PathSteps, path: list[int], heading: float, register: Register, random: Random
) -> tuple[list[Leg], Detail, bool]:
    """Returns the first description from which the follower finds a path, its detail, and True.

    Returns the last description, its detail, and False if the follower finds the path from none.
    """
    tries = {"short": _short_descriptions, "detailed": _detailed_descriptions, "rxr": _long_descriptions}[register]
    for legs, detail in tries(ground, path, heading, random):
        said = round_legs(with_one_name_each(legs), detail)
        if find_described_path(ground, path[0], heading, said) == path:
            return _without_needless(ground, path, heading, said) if register == "short" else said, detail, True
    return said, detail, False


def _without_needless(ground: PathSteps, path: list[int], heading: float, said: list[Leg]) -> list[Leg]:
    """Removes distances, and objects besides two other cues of a leg, that the follower does not need."""
    for i in range(len(said)):
        for cue in (None, *sorted(said[i].cues)):
            leg = replace(said[i], meters=None) if cue is None else replace(said[i], cues=said[i].cues - {cue})
            is_end = cue is not None and cue.kind == "by" and i + 1 == len(said)
            if leg == said[i] or is_end or cue is not None and (cue.object_index < 0 or len(leg.cues) < 2):
                continue
            fewer = [*said[:i], leg, *said[i + 1 :]]
            if find_described_path(ground, path[0], heading, fewer) == path:
                said = fewer
    return said


def with_one_name_each(legs: Sequence[Leg]) -> list[Leg]:
    """Removes cues of objects whose name stands for another object in an earlier leg, or later in the same leg."""
    named: dict[str, int] = {}
    kept = []
    for leg in legs:
        cues = []
        for cue in sorted(leg.cues, key=lambda c: (c.distance, c)):
            if cue.object_index >= 0:
                if any(i != cue.object_index and may_mean_the_same(name, cue.subject) for name, i in named.items()):
                    continue
                named[cue.subject] = cue.object_index
            cues.append(cue)
        kept.append(replace(leg, cues=frozenset(cues)))
    return kept


Tries = Iterator[tuple[Sequence[Leg], Detail]]


def _short_descriptions(ground: PathSteps, path: list[int], heading: float, random: Random) -> Tries:
    """Yields descriptions from few to all facts: first with bends inside legs, rough distances, and one or two cues."""
    forms = list(ground.legs_with_bends(path, heading))
    for most, measure in _AMOUNTS:
        for form in forms:
            yield _with_few_cues(form, most, measure, random), "words"
    full = [replace(leg, cues=drop_redundant_cues(leg.cues), measure="paces") for leg in forms[-1]]
    for detail in DETAILS:
        yield full, detail


def _with_few_cues(legs: Sequence[Leg], most: int, measure: Measure | None, random: Random) -> list[Leg]:
    """Selects cues, and states the distance by `measure` only of legs whose end no cue marks; None: of the last leg."""
    found = []
    for i, leg in enumerate(legs):
        is_last = i + 1 == len(legs)
        some = replace(leg, cues=choose_few_cues(leg.cues, most, is_last, random), measure=measure or "roughly")
        is_stated = (measure is not None or is_last) and not _ends_by_sight(some)
        found.append(some if is_stated else replace(some, meters=None))
    return found


def _detailed_descriptions(ground: PathSteps, path: list[int], heading: float, random: Random) -> Tries:
    """Yields descriptions with some of the cues, then with all. The first omits distances that may be needless."""
    whole = [
        replace(leg, cues=frozenset(c for c in leg.cues if c.kind != "past" or c.side))
        for leg in ground.legs(path, heading)
    ]
    for _ in range(5):  # until the text names a landmark, if there is one
        legs = [replace(leg, cues=choose_cues(leg.cues, random)) for leg in whole]
        if any(leg.cues for leg in legs):
            break
    fewer = [replace(leg, meters=None) if _ends_by_sight(leg) and random.random() < _WITHOUT else leg for leg in legs]
    if fewer != legs:
        yield fewer, "words"
    if any(leg.cues for leg in legs):
        for detail in DETAILS:
            yield legs, detail
    yield from _long_descriptions(ground, path, heading, random)


def _long_descriptions(ground: PathSteps, path: list[int], heading: float, random: Random) -> Tries:
    """Yields descriptions with all cues and distances."""
    for detail in DETAILS:
        yield [replace(leg, cues=drop_redundant_cues(leg.cues)) for leg in ground.legs(path, heading)], detail


def _ends_by_sight(leg: Leg) -> bool:
    """Whether a cue marks the end of the leg."""
    return any(cue.kind in ENDS for cue in leg.cues)


def describe_path(ground: PathSteps, path: list[int], heading: float) -> tuple[list[Leg], Detail, bool]:
    """Describes a path (rows of Ways) that begins with heading `heading` (radians).

    Returns the legs in the coarsest detail from which the follower finds the path, that detail, and True. If no detail
    is enough, returns the finest one and False.
    """
    legs = [replace(leg, cues=drop_redundant_cues(leg.cues)) for leg in ground.legs(path, heading)]
    for detail in DETAILS:
        said = round_legs(legs, detail)
        if find_described_path(ground, path[0], heading, said) == path:
            return said, detail, True
    return said, detail, False
