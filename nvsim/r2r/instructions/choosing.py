"""Selects which cues along a leg the instruction mentions: few, and rather those at its end."""

from __future__ import annotations

from collections.abc import Set
from random import Random

from nvsim.r2r.instructions.cues import Cue

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
_MOST = 2  # largest number of cues besides the doorway


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
    return frozenset([*doors, *some[:_MOST]])
