"""Cues along a leg that an instruction can mention and a follower can check: doorways, rooms, objects, floors, stairs.

An instruction mentions few of them, and rather those at the end of the leg.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from random import Random
from typing import Literal

from nvsim.graph.slopes import Slope
from nvsim.r2r.surroundings.floor_kinds import RUG, floors_differ
from nvsim.r2r.surroundings.survey import SAME_DOORWAY, Pair, Surroundings

CueKind = Literal["through", "out of", "into", "along", "past", "by", "floor", "rug", "stairs", "to stairs"]
CueSide = Literal["", "left", "right", "ahead"]
_STEADY = 4  # smallest number of positions, 0.2 m apart, on one floor before and after a change
_BESIDE = (math.radians(55), math.radians(125))
_AHEAD = math.radians(20)
_SAID = {
    "through": 0.9,
    "along": 0.6,
    "floor": 0.7,
    "past": 0.6,
    "by": 0.6,
    "rug": 0.8,
    "stairs": 0.9,
    "to stairs": 0.7,
}
"""Probability that a cue of each kind is mentioned."""
_ROOMS = 0.6  # probability that the room before or after the doorway is mentioned
_MOST_CUES = 2  # largest number of cues besides the doorway


@dataclass(frozen=True, order=True)
class Cue:
    """A cue along a leg.

    kind   "through" doorways, "out of" or "into" a room or corridor if there is one doorway, "along" a corridor,
           "past" an object, "by" an object where the leg ends, "floor" that changes once, "rug" along the way,
           "stairs" that end at the end of the leg, "to stairs" that begin there
    what   number of doorways; room or corridor; "COLOUR SHAPE" of an object; "FLOOR to FLOOR"; "onto", "off" or
           "across" and the name of a rug; "top" or "bottom" of stairs; "up" or "down" for the direction of stairs
    side   of an object, seen in the direction of movement
    """

    kind: CueKind
    what: str
    side: CueSide = ""


def cues_along(ids: Sequence[str], facing: float, seen: Surroundings) -> frozenset[Cue]:
    """Returns all cues of a leg over viewpoints `ids` (two or more) that ends with heading `facing` (radians)."""
    steps = list(zip(ids, ids[1:]))
    if any(step not in seen.doors for step in steps):
        return frozenset(_by(ids[-1], facing, seen))  # steps between storeys have no other cues
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
    """Yields the positions of doorways along the leg in meters. Doorways within a wall's thickness count as one."""
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
    """Finds a lasting change from one floor to another, or a rug. Unnamed positions are ignored."""
    runs = _runs([name for step in steps for name in seen.floors[step] if name])
    if not 2 <= len(runs) <= 3 or min(length for _, length in runs) < _STEADY:
        return
    names = [name for name, _ in runs]
    rugs = [name.endswith(RUG) for name in names]
    if len(names) == 2 and not any(rugs):
        yield Cue("floor", " to ".join(names))
    elif rugs in ([False, True], [True, False], [False, True, False]):
        how = "across" if len(names) == 3 else "onto" if rugs[1] else "off"
        yield Cue("rug", f"{how} {names[rugs.index(True)]}")


def _runs(names: Sequence[str]) -> list[tuple[str, int]]:
    """Returns the sequence of floors: the most frequent name of each, and the number of positions on it."""
    runs: list[list[str]] = []
    for name in names:
        if not runs or any(floors_differ(name, other) for other in set(runs[-1])):
            runs.append([])
        runs[-1].append(name)
    return [(Counter(run).most_common(1)[0][0], len(run)) for run in runs]


def _look(seen: Surroundings, i: int) -> str:
    return " ".join(seen.things[i].look)


def stair_cues(slopes: Sequence[Sequence[Slope]], leg: Slope) -> Iterator[Cue]:
    """Yields a cue if a leg ends where stairs end or begin.

    slopes   for each viewpoint of the leg (two or more), the slopes of all its steps
    leg      slope of the leg
    """
    before, end = slopes[:-1], slopes[-1]
    if leg != "level":
        if leg not in end and "level" in end:
            yield Cue("stairs", "top" if leg == "up" else "bottom")
        return
    ways = {slope for slope in end if slope != "level"}
    if len(ways) == 1 and not any(ways & set(other) for other in before):
        yield Cue("to stairs", ways.pop())


def drop_redundant_cues(cues: Set[Cue]) -> frozenset[Cue]:
    """Removes "past" cues of objects that also have a "by" cue at the end of the leg."""
    ends = {cue.what for cue in cues if cue.kind == "by"}
    return frozenset(cue for cue in cues if cue.kind != "past" or cue.what not in ends)


def chosen_cues(cues: Set[Cue], random: Random) -> frozenset[Cue]:
    """Selects cues at random: at most one of each kind."""
    some: list[Cue] = []
    doors: list[Cue] = []
    for kind in ("through", "stairs", "to stairs", "floor", "rug", "along", "by", "past"):
        named = {cue.what for cue in some}
        of_kind = [cue for cue in sorted(cues) if cue.kind == kind and cue.what not in named]
        if not of_kind or random.random() >= _SAID[kind]:
            continue
        one = of_kind[int(random.random() * len(of_kind))]
        if kind == "through" and int(one.what) > 2:
            continue
        (doors if kind == "through" else some).append(one)
    if doors:
        doors += [cue for cue in sorted(cues) if cue.kind in ("out of", "into") and random.random() < _ROOMS]
    return frozenset([*doors, *some[:_MOST_CUES]])
