"""What is seen along a leg, as facts that can be said and checked: doorways, rooms and corridors, things beside the
way, changes of the floor."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

from nvsim.r2r.surroundings.colour_names import differ
from nvsim.r2r.surroundings.survey import SAME_DOORWAY, Pair, Surroundings

CueKind = Literal["through", "out of", "into", "along", "past", "by", "floor"]
CueSide = Literal["", "left", "right", "ahead"]
_STEADY = 4  # places 0.2 m apart of one floor before and after a change
_BESIDE = (math.radians(55), math.radians(125))
_AHEAD = math.radians(20)


@dataclass(frozen=True, order=True)
class Cue:
    """kind   "through" doorways, "out of" or "into" a room or corridor through the only one, "along" a corridor,
           "past" a thing, "by" a thing where the leg ends, "floor" that changes once
    what   how many doorways; room or corridor; "COLOUR SHAPE" of a thing; "COLOUR to COLOUR"
    side   of a thing, for one who looks along the way
    """

    kind: CueKind
    what: str
    side: CueSide = ""


def cues_along(ids: Sequence[str], facing: float, seen: Surroundings) -> frozenset[Cue]:
    """All cues of a leg over viewpoints `ids`, two or more, at whose end one looks to `facing` (radians)."""
    steps = list(zip(ids, ids[1:]))
    if any(step not in seen.doors for step in steps):
        return frozenset()  # of steps between storeys nothing is known
    found = [*_doorways(ids, steps, seen), *_past(steps, seen), *_by(ids[-1], facing, seen), *_floor(steps, seen)]
    return frozenset(found)


def _doorways(ids: Sequence[str], steps: Sequence[Pair], seen: Surroundings) -> Iterator[Cue]:
    doors = len(set(_doors_of(steps, seen)))
    first, last = (seen.kinds.get(id, "") for id in (ids[0], ids[-1]))
    if doors:
        yield Cue("through", str(doors))
    elif all(seen.kinds.get(id) == "corridor" for id in ids):
        yield Cue("along", "corridor")
    if doors == 1:
        if first:
            yield Cue("out of", first)
        if last:
            yield Cue("into", last)


def _doors_of(steps: Sequence[Pair], seen: Surroundings) -> Iterator[float]:
    """Metres along the leg at which it leads through doorways; those nearer than a wall is thick are one."""
    walked, last = 0.0, -math.inf
    for step in steps:
        for metres in seen.doors[step]:
            if walked + metres - last > SAME_DOORWAY:
                last = walked + metres
            yield last
        walked += seen.metres[step]


def _past(steps: Sequence[Pair], seen: Surroundings) -> Iterator[Cue]:
    sides: dict[str, set[CueSide]] = defaultdict(set)
    for step in steps:
        for i, side in seen.passed[step]:
            sides[_look(seen, i)].add(side)
    for look, where in sides.items():
        if len(where) == 1:
            yield Cue("past", look, *where)


def _by(id: str, facing: float, seen: Surroundings) -> Iterator[Cue]:
    sides: dict[str, set[CueSide]] = defaultdict(set)
    for i, heading, _ in seen.near.get(id, ()):
        off = (heading - facing + math.pi) % (2 * math.pi) - math.pi
        side: CueSide = "ahead" if abs(off) <= _AHEAD else ""
        if _BESIDE[0] <= abs(off) <= _BESIDE[1]:
            side = "right" if off > 0 else "left"
        sides[_look(seen, i)].add(side)
    for look, where in sides.items():
        if len(where) == 1 and "" not in where:
            yield Cue("by", look, *where)


def _floor(steps: Sequence[Pair], seen: Surroundings) -> Iterator[Cue]:
    """A change from one colour to another for good: what comes in between has no name, or is one of both."""
    names = [name for step in steps for name in seen.floors[step]]
    runs = [(name, len(list(run))) for name, run in groupby(name for name in names if name)]
    if len(runs) == 2 and differ(runs[0][0], runs[1][0]) and min(runs[0][1], runs[1][1]) >= _STEADY:
        yield Cue("floor", f"{runs[0][0]} to {runs[1][0]}")


def _look(seen: Surroundings, i: int) -> str:
    return " ".join(seen.things[i].look)
