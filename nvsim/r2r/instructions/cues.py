"""Cues along a leg that an instruction can mention and a follower can check: doorways, rooms, objects, floors, stairs.

An instruction mentions few of them, and rather those at the end of the leg.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass, field
from random import Random
from typing import Literal

from nvsim.graph.quantities import Slope
from nvsim.r2r.surroundings.floor_kinds import EVERY, RUG, floors_differ
from nvsim.r2r.surroundings.survey import NEAR, SAME_DOORWAY, Pair, Surroundings

CueKind = Literal[
    "through", "out of", "into", "along", "towards", "past", "by", "floor", "rug", "stairs", "to stairs"
]  # fmt: skip
CueSide = Literal["", "left", "right", "ahead"]
ENDS = ("by", "into", "through", "stairs", "to stairs")
"""Kinds of cues that mark the end of a leg."""
_STEADY = 4  # smallest number of positions, 0.2 m apart, on one floor before and after a change
_AT_DOOR = 0.6  # largest distance in meters between a change of the floor and a doorway; elsewhere it may be a rug
_ACROSS = 3.0  # smallest length in meters of a leg across a room
_CLOSE = 1.7  # largest distance in meters to an object next to the end of a leg, on any side
_BESIDE = (math.radians(55), math.radians(125))
_AHEAD = math.radians(20)
_TOWARDS = (math.radians(30), math.radians(15))  # largest angles to an object ahead: from the first and the last step
_SAID = {
    "through": 0.9,
    "along": 0.6,
    "floor": 0.7,
    "towards": 0.3,
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

    kind          "through" doorways, "out of" or "into" a room or corridor if there is one doorway, "along" a corridor
                  or across a room, "towards" an object that is ahead and not reached, "past" an object, "by" an object
                  where the leg ends, "floor" that changes once, "rug" along the way, "stairs" that end at the end of
                  the leg, "to stairs" that begin there
    subject       number of doorways; room or corridor; "COLOUR SHAPE" of an object, whose color can be empty; "FLOOR to
                  FLOOR"; "onto", "off" or "across" and the name of a rug; "top" or "bottom" of stairs; "up" or "down"
                  for the direction of stairs
    side          of an object, seen in the direction of movement; "" for an object on any side
    distance      meters from the begin of the leg
    object_index  index of the object in the surroundings, -1 if it is none; equal words of one text mean one object
    """

    kind: CueKind
    subject: str
    side: CueSide = ""
    distance: float = field(default=0.0, compare=False)
    object_index: int = field(default=-1, compare=False)


def cues_along(ids: Sequence[str], facing: float, seen: Surroundings) -> frozenset[Cue]:
    """Returns all cues of a leg over viewpoints `ids` (two or more) that ends with heading `facing` (radians)."""
    steps = list(zip(ids, ids[1:]))
    if any(step not in seen.doors for step in steps):
        return frozenset(_objects_at_end(ids, 0.0, facing, seen))  # steps between storeys have no other cues
    length = sum(seen.meters[step] for step in steps)
    found = [
        *_doorways(ids, steps, seen),
        *_passed_objects(ids, steps, seen),
        *_objects_at_end(ids, length, facing, seen),
    ]
    found += [*_floor(steps, seen), *_cues_ahead(ids, steps, facing, seen)]
    return frozenset(found)


def _doorways(ids: Sequence[str], steps: Sequence[Pair], seen: Surroundings) -> Iterator[Cue]:
    places = sorted(set(_doors_of(steps, seen)))
    kinds = [seen.kinds.get(id, "") for id in ids]
    if places:
        yield Cue("through", str(len(places)), distance=places[0])
    elif set(kinds) == {"corridor"}:
        yield Cue("along", "corridor")
    elif set(kinds) == {"room"} and sum(seen.meters[step] for step in steps) >= _ACROSS:
        yield Cue("along", "room")
    if len(places) == 1:
        if kinds[0]:
            yield Cue("out of", kinds[0], distance=places[0])
        if kinds[-1]:
            yield Cue("into", kinds[-1], distance=places[0])


def _doors_of(steps: Sequence[Pair], seen: Surroundings) -> Iterator[float]:
    """Yields the positions of doorways along the leg in meters. Doorways within a wall's thickness count as one."""
    walked, last = 0.0, -math.inf
    for step in steps:
        for meters in seen.doors[step]:
            if walked + meters - last > SAME_DOORWAY:
                last = walked + meters
            yield last
        walked += seen.meters[step]


def _is_unique(look: str, i: int, ids: Sequence[str], seen: Surroundings, meters: float = NEAR) -> bool:
    """Whether no other object of this look is visible within so many meters of the viewpoints."""
    others = {j for id in ids for j, _, far in seen.visible.get(id, ()) if far <= meters}
    return not any(may_mean_the_same(_color_and_shape(seen, j), look) for j in others - {i})


def _passed_objects(ids: Sequence[str], steps: Sequence[Pair], seen: Surroundings) -> Iterator[Cue]:
    passed: dict[int, list[tuple[CueSide, float]]] = defaultdict(list)
    walked = 0.0
    for step in steps:
        for i, beside, meters in seen.passed[step]:
            passed[i].append((beside, walked + meters))
        walked += seen.meters[step]
    for i, places in passed.items():
        look = _color_and_shape(seen, i)
        if not _is_unique(look, i, ids, seen) or any(
            may_mean_the_same(_color_and_shape(seen, j), look) for j in passed if j != i
        ):
            continue
        side, at = places[-1]
        if all(other == side for other, _ in places):
            yield Cue("past", look, side, at, i)
            yield Cue("past", look, "", at, i)


def _objects_at_end(ids: Sequence[str], length: float, facing: float, seen: Surroundings) -> Iterator[Cue]:
    """Finds objects at the end of a leg of `length` meters. They must not be behind the agent."""
    for i, heading, meters in seen.visible.get(ids[-1], ()):
        look, off = _color_and_shape(seen, i), _wrap_angle(heading - facing)
        if meters > NEAR or abs(off) > _BESIDE[1] or not _is_unique(look, i, ids[-1:], seen):
            continue
        if meters <= _CLOSE:
            yield Cue("by", look, "", length, i)
        if abs(off) <= _AHEAD:
            yield Cue("by", look, "ahead", length, i)
        elif abs(off) >= _BESIDE[0]:
            yield Cue("by", look, "right" if off > 0 else "left", length, i)


def _cues_ahead(ids: Sequence[str], steps: Sequence[Pair], facing: float, seen: Surroundings) -> Iterator[Cue]:
    """Finds objects ahead that are visible from the first and the last step, and that the leg does not reach."""
    if any(seen.doors[step] for step in steps):
        return
    last = {i: (heading, meters) for i, heading, meters in seen.visible.get(ids[-2], ())}
    for i, heading, _ in seen.visible.get(ids[0], ()):
        if i not in last or abs(_wrap_angle(heading - facing)) > _TOWARDS[0]:
            continue
        ahead, meters = last[i]
        near = abs(_wrap_angle(ahead - facing)) <= _TOWARDS[1] and meters > seen.meters[steps[-1]] + 0.2
        if near and _is_unique(_color_and_shape(seen, i), i, ids[:1], seen, math.inf):
            yield Cue("towards", _color_and_shape(seen, i), "", 0.0, i)


def objects_around(id: str, facing: float, seen: Surroundings) -> Iterator[Cue]:
    """Yields the objects ahead, and those within 3 m on the left and right, of a viewpoint; the nearest first."""
    for i, heading, meters in sorted(seen.visible.get(id, ()), key=lambda one: one[2]):
        off = _wrap_angle(heading - facing)
        side: CueSide = "ahead" if abs(off) <= _AHEAD else "right" if off > 0 else "left"
        if not is_unnamed(_color_and_shape(seen, i)) and (
            side == "ahead" or _BESIDE[0] <= abs(off) <= _BESIDE[1] and meters < _ACROSS
        ):
            yield Cue("by", _color_and_shape(seen, i), side, 0.0, i)


def _wrap_angle(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


def _floor(steps: Sequence[Pair], seen: Surroundings) -> Iterator[Cue]:
    """Finds a lasting change from one floor to another in a doorway, or a rug. Unnamed positions are ignored."""
    runs = _runs([(name, (i + 0.5) * EVERY) for i, name in enumerate(n for s in steps for n in seen.floors[s]) if name])
    if not 2 <= len(runs) <= 3 or min(run.length for run in runs) < _STEADY:
        return
    names, at = [run.name for run in runs], (runs[0].end + runs[1].begin) / 2
    rugs = [name.endswith(RUG) for name in names]
    if len(names) == 2 and not any(rugs):
        if any(runs[0].end - _AT_DOOR <= door <= runs[1].begin + _AT_DOOR for door in _doors_of(steps, seen)):
            yield Cue("floor", " to ".join(names), distance=at)
    elif rugs in ([False, True], [True, False], [False, True, False]):
        how = "across" if len(names) == 3 else "onto" if rugs[1] else "off"
        yield Cue("rug", f"{how} {names[rugs.index(True)]}", distance=at)


@dataclass(frozen=True)
class _FloorStretch:
    """A part of a leg on one floor: its most frequent name, the number of positions, and begin and end in meters."""

    name: str
    length: int
    begin: float
    end: float


def _runs(named: Sequence[tuple[str, float]]) -> list[_FloorStretch]:
    """Returns the sequence of floors for names at positions in meters."""
    runs: list[list[tuple[str, float]]] = []
    for name, at in named:
        if not runs or any(floors_differ(name, other) for other in {one for one, _ in runs[-1]}):
            runs.append([])
        runs[-1].append((name, at))
    return [
        _FloorStretch(Counter(n for n, _ in run).most_common(1)[0][0], len(run), run[0][1], run[-1][1]) for run in runs
    ]


def _color_and_shape(seen: Surroundings, i: int) -> str:
    return " ".join(seen.things[i].color_and_shape)


def may_mean_the_same(look: str, other: str) -> bool:
    """Whether two "COLOUR SHAPE" may be names of one object: a name without a color fits every color."""
    color, _, shape = look.partition(" ")
    other_color, _, other_shape = other.partition(" ")
    return shape == other_shape and (color == other_color or "" in (color, other_color))


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
    """Removes cues that others make needless: of an object with a better cue, without its side, and at the same end."""
    kept: dict[int, Cue] = {}
    for kind in ("by", "past", "towards"):
        of_kind = sorted((c for c in cues if c.kind == kind), key=lambda c: (is_unnamed(c.subject), c.side == "", c))
        for cue in of_kind[:1] if kind != "past" else of_kind:
            kept.setdefault(cue.object_index, cue)
    plain = {cue for cue in cues if cue.kind not in ("by", "past", "towards")}
    return frozenset(plain | set(kept.values()))


def choose_cues(cues: Set[Cue], random: Random) -> frozenset[Cue]:
    """Selects cues at random: at most one of each kind, and rather with a side."""
    some: list[Cue] = []
    doors: list[Cue] = []
    for kind in ("through", "stairs", "to stairs", "floor", "rug", "along", "by", "past", "towards"):
        named = {cue.subject for cue in some}
        of_kind = [cue for cue in sorted(cues) if cue.kind == kind and cue.subject not in named]
        if not of_kind or random.random() >= _SAID[kind]:
            continue
        best = [cue for cue in of_kind if not is_unnamed(cue.subject)] or of_kind
        one = best[int(random.random() * len(best))]
        if kind == "through" and int(one.subject) > 2:
            continue
        (doors if kind == "through" else some).append(one)
    if doors:
        doors += [cue for cue in sorted(cues) if cue.kind in ("out of", "into") and random.random() < _ROOMS]
    return frozenset([*doors, *some[:_MOST_CUES]])


def is_unnamed(look: str) -> bool:
    """Whether an object has no better name than "object". Such names are used only if there is no other landmark."""
    return look.endswith(" object")


def choose_few_cues(cues: Set[Cue], most: int, is_last: bool, random: Random) -> frozenset[Cue]:
    """Selects the cues of a leg for a short text: doorways or stairs, then up to `most` others.

    The last leg gets an object at its end if there is one. Vague names are used only if there is no other cue.
    """
    doors = [cue for cue in sorted(cues) if cue.kind in ("through", "out of", "into")]
    found = [cue for cue in sorted(cues) if cue.kind in ("stairs", "to stairs")]
    found += doors if any(cue.kind == "through" and int(cue.subject) <= 2 for cue in doors) else []
    others = [cue for cue in sorted(cues) if cue not in doors and cue.kind not in ("stairs", "to stairs")]
    clear = [cue for cue in others if not is_unnamed(cue.subject)]
    others = clear or ([] if found else others)
    ends = [cue for cue in others if cue.kind == "by"] if is_last else []
    if ends:
        found.append(ends[int(random.random() * len(ends))])
        most -= 1
    most -= bool(doors) and most < 2
    while others and most > 0:
        kinds = sorted({cue.kind for cue in others})
        kind = kinds[int(random.random() * len(kinds))]
        of_kind = [cue for cue in others if cue.kind == kind]
        one = of_kind[int(random.random() * len(of_kind))]
        taken = any(cue.kind == kind or cue.subject == one.subject for cue in found)
        others = [cue for cue in others if cue != one] if taken else [cue for cue in others if cue.kind != kind]
        if not taken:
            found.append(one)
            most -= 1
    return frozenset(found)
