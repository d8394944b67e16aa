"""Words of the register rxr: long descriptions of views and movements with meters, as in RxR."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

from nvsim.r2r.instructions.cues import Cue
from nvsim.r2r.instructions.ground import Detail, Leg, View
from nvsim.r2r.instructions.phrases import CORRIDOR, Names, one_of, sentence, spoken
from nvsim.r2r.instructions.wording import WALK_PHRASES, cue_words, metre_words, turn_words

_PLACES = {"room": "[in a room|inside a room]", "corridor": f"in a {CORRIDOR}", "": ""}
_BEGIN = "[you are standing|you are starting|you begin|you start] {}"
_FACING = "[facing|looking at|and in front of you there is] a {}"
_SIDES = {
    "left": "[on|to] your left [side|] there is a {}",
    "right": "[on|to] your right [side|] there is a {}",
    "ahead": "[in front of you there is|ahead of you is|you can see in front of you] a {}",
}
_NOW = "[you are now|you will now be|now you are|you should now be] {}"
_VIEW = {
    "ahead": "[you are now facing|you will see ahead of you|in front of you, you will see] a {}",
    "left": "[on your left you will see|to your left there is] a {}",
    "right": "[on your right you will see|to your right there is] a {}",
}
_ENDS = (
    "this is the end of your path", "you have reached your destination", "this is where you stop",
    "stop here, you are done", "here you have reached your end point", "once you are there, stop, you are done",
)  # fmt: skip
_STAND = {
    "left": "[stop|wait|stand] here, with the {} on your left side",
    "right": "[stop|wait|stand] here, with the {} on your right side",
    "ahead": "[stop|wait|stand] here, right in front of the {}",
    "": "[stop|wait|stand] here, close to the {}",
}
_OPENERS = ("", "", "now ", "then ", "next, ", "after that, ", "from here, ")


def long_instruction(
    said: Sequence[Leg], views: Sequence[View], detail: Detail, random: Random
) -> list[tuple[str, int]]:
    """Returns the sentences of an instruction of the register rxr, for legs that were rounded to `detail`. Each has the
    number of the leg that it describes; len(said) is the end of the path.

    `views` are the view at the start, and the view at the start of each leg after its turn.
    """
    names = Names(random)
    found = [(text, 0) for text in _begin(views[0], names, random)]
    for i, leg in enumerate(said):
        opener = one_of(_OPENERS, random) if i else ""
        turn = turn_words(leg, detail, random)
        seen = [cue for cue in views[i + 1].objects if cue.side == "ahead"]
        if turn:
            found.append((sentence(opener + turn), i))
            opener = ""
            if seen:
                found.append((sentence(spoken(_VIEW["ahead"], random).format(names.of(seen[0]))), i))
        last = i + 1 == len(said)
        by = (
            next((cue for cue in sorted(leg.cues, key=lambda c: c.side == "") if cue.kind == "by"), None)
            if last
            else None
        )
        found.append((sentence(opener + _walk(leg, by, not turn, names, random)), i))
        into = [cue.what for cue in leg.cues if cue.kind == "into"]
        if into:
            found.append((sentence(spoken(_NOW, random).format(spoken(_PLACES[into[0]], random))), i + 1))
        if by is not None:
            found.append((sentence(spoken(_STAND[by.side], random).format(names.of(by))), i + 1))
    found.append((sentence(one_of(_ENDS, random)), len(said)))
    return found


def _begin(view: View, names: Names, random: Random) -> list[str]:
    """Returns the sentences about the start."""
    ahead = [cue for cue in view.objects if cue.side == "ahead"]
    place = spoken(_PLACES[view.kind], random)
    found = []
    if place or ahead:
        facing = spoken(_FACING, random).format(names.of(ahead[0])) if ahead else ""
        words = spoken(_BEGIN, random).format(place).rstrip()
        found.append(sentence(f"{words}, {facing}" if facing else words))
    for side in ("left", "right"):
        beside = [cue for cue in view.objects if cue.side == side and cue not in ahead]
        if beside and random.random() < 0.7:
            found.append(sentence(spoken(_SIDES[side], random).replace("  ", " ").format(names.of(beside[0]))))
    return found


def _walk(leg: Leg, by: Cue | None, straight: bool, names: Names, random: Random) -> str:
    cues = sorted(leg.cues - ({by} if by is not None else set()))
    metres = "" if leg.metres is None else metre_words(leg.metres, random)
    walk = one_of(WALK_PHRASES[leg.slope], random).format(metres)
    walk = walk.replace("*", "")
    walk += " straight ahead" if straight and leg.slope == "level" else ""
    said = cue_words(cues, names, random)
    return f"{walk}, {said}" if said else walk
