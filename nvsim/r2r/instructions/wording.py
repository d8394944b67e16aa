"""Words of the detailed register and of the register rxr: every fact in a clause of its own, with meters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from random import Random

from nvsim.graph.quantities import Slope
from nvsim.r2r.instructions.cues import Cue
from nvsim.r2r.instructions.ground import Detail, Leg, View
from nvsim.r2r.instructions.phrases import CORRIDOR, FLOOR_OF, WordChoice, sentence, turn_words

PAST = {
    "": ("passing the {}", "going past the {}"),
    "left": ("past the {} on your left", "with the {} on your left", "keeping the {} on your left"),
    "right": ("past the {} on your right", "with the {} on your right", "keeping the {} on your right"),
}
BY = {
    "": ("until you are close to the {}", "until you come to the {}"),
    "left": ("until the {} is to your left", "until the {} is next to you on the left"),
    "right": ("until the {} is to your right", "until the {} is next to you on the right"),
    "ahead": ("until you stand before the {}", "until the {} is right in front of you", "up to the {} in front of you"),
}
STOP_BY = {
    "": ("Stop close to the {}.", "Wait near the {}.", "End by the {}."),
    "left": (
        "Stop with the {} to your left.",
        "Wait where the {} is to your left.",
        "End next to the {}, on your left.",
    ),
    "right": (
        "Stop with the {} to your right.",
        "Wait where the {} is to your right.",
        "End next to the {}, on your right.",
    ),
    "ahead": ("Stop before the {}.", "Wait in front of the {}.", "End facing the {}."),
}
THROUGH = {
    "1": ("through the doorway", "through the door", "through the door opening"),
    "2": ("through two doorways", "through two doors", "through both doorways"),
}
OUT_OF = {"room": ("out of the room", "leaving the room"), "corridor": ("out of the corridor", "leaving the hallway")}
INTO = {"room": ("into the next room", "entering a room"), "corridor": ("into the corridor", "entering the hallway")}
ALONG = {
    "corridor": ("along the corridor", "down the hallway", "following the corridor"),
    "room": ("across the room", "across this room"),
}
TOWARDS = ("towards the {}", "in the direction of the {}")
FLOOR = (
    "from the {0} floor onto the {1} one",
    "to where the floor changes from {2} to {3}",
    "to where the {0} floor gives way to a {1} one",
)
"""0, 1: adjectives of the two floors; 2, 3: their materials."""
RUG = {
    "onto": ("onto the {}", "to where the {} begins"),
    "off": ("off the {}", "to where the {} ends"),
    "across": ("across the {}", "over the {}"),
}
STAIRS = {"top": ("to the top", "all the way up"), "bottom": ("to the bottom", "all the way down")}
TO_STAIRS = {
    "up": ("to the foot of the stairs", "to where the stairs lead up"),
    "down": ("to the top of the stairs", "to where the stairs lead down"),
}
TURN_PHRASES: dict[str, tuple[str, ...]] = {
    "slightly right": ("bear right", "turn slightly right", "veer to the right"),
    "slightly left": ("bear left", "turn slightly left", "veer to the left"),
    "right": ("turn right", "make a right turn", "turn to your right"),
    "left": ("turn left", "make a left turn", "turn to your left"),
    "sharply right": ("turn sharply right", "make a sharp right turn", "turn far to the right"),
    "sharply left": ("turn sharply left", "make a sharp left turn", "turn far to the left"),
    "around": ("turn around", "turn back", "make a U-turn"),
}
AHEAD_PHRASES = ("straight ahead", "straight on", "without turning")
"""Follows the walk or the stairs if there is no turn."""
CLOCK_PHRASES = ("turn to {} o'clock", "face {} o'clock", "turn towards {} o'clock")
DEGREE_PHRASES = ("turn {} degrees to the {}", "turn {} degrees {}", "make a turn of {} degrees to the {}")
WALK_PHRASES: dict[Slope, tuple[str, ...]] = {
    "level": ("walk {}", "go {}", "move forward {}", "advance {}"),
    "up": (
        "go up the stairs*, {} higher",
        "climb the stairs* until you are {} higher",
        "walk up the stairs*, rising {}",
    ),
    "down": (
        "go down the stairs*, {} lower",
        "descend the stairs* until you are {} lower",
        "walk down the stairs*, dropping {}",
    ),
}
"""The star is replaced by a phrase for straight ahead. For up and down, meters are height differences."""
ON_PHRASES: dict[Slope, tuple[str, ...]] = {
    "level": ("walk", "go", "continue", "move forward"),
    "up": ("go up the stairs*", "climb the stairs*", "walk up the stairs*"),
    "down": ("go down the stairs*", "descend the stairs*", "walk down the stairs*"),
}
"""Phrases for a leg without a distance."""
METER_PHRASES = ("{} meters", "about {} meters", "roughly {} meters", "some {} meters")
HALF_METER = ("half a meter", "about half a meter", "roughly half a meter")
ONE_METER = ("one meter", "about one meter", "a single meter")
_LINKS = ("", "then ", "next, ", "after that, ", "now ")
_BOTH = ("{} and {}", "{}, then {}", "{} and then {}")
ENDS = ("Stop there.", "Stop.", "You have arrived.", "Wait there.", "That is the place.")


def cue_words(cues: Sequence[Cue], wording: WordChoice) -> str:
    """Returns the words for cues within a sentence, "" if there are no cues."""
    said = [*_doors(cues, wording)]
    for cue in sorted(cues):
        if cue.kind == "along":
            said.append(wording.choose(ALONG[cue.subject]))
        elif cue.kind == "towards":
            said.append(wording.choose_about(TOWARDS, cue))
        elif cue.kind == "floor":
            said.append(wording.choose(FLOOR, *_floors(cue)))
        elif cue.kind == "rug":
            how, _, rug = cue.subject.partition(" ")
            said.append(wording.choose(RUG[how], rug))
    said += [wording.choose(STAIRS[c.subject]) for c in sorted(cues) if c.kind == "stairs"]
    said += [wording.choose(TO_STAIRS[c.subject]) for c in sorted(cues) if c.kind == "to stairs"]
    past = [c for c in sorted(cues, key=lambda c: (c.distance, c)) if c.kind == "past"]
    door = min((c.distance for c in cues if c.kind == "through"), default=0.0)
    before = [_past_words(c, wording) for c in past if c.distance < door]
    said = [*before, *said, *(_past_words(c, wording) for c in past if c.distance >= door)]
    said += [wording.choose_about(BY[c.side], c) for c in sorted(cues) if c.kind == "by"]
    return ", ".join(said)


def _past_words(cue: Cue, wording: WordChoice) -> str:
    return wording.choose_about(PAST[cue.side], cue)


def stop_words(cue: Cue, wording: WordChoice) -> str:
    """Returns the last sentence, for a path that ends next to an object."""
    return wording.choose_about(STOP_BY[cue.side], cue)


def _floors(cue: Cue) -> list[str]:
    names = cue.subject.split(" to ")
    return [*names, *(FLOOR_OF.get(name, name) for name in names)]


def _doors(cues: Sequence[Cue], wording: WordChoice) -> Sequence[str]:
    of = {cue.kind: cue.subject for cue in cues}
    if "through" not in of:
        return []
    words = [wording.choose(THROUGH[of["through"]])]
    if "out of" in of:
        phrase = wording.choose(OUT_OF[of["out of"]])
        # "leaving the room" is a separate clause; "out of the room" comes before the doorway.
        words = [phrase, words[0]] if phrase.startswith("leaving") else [f"{phrase} {words[0]}"]
    if "into" in of:
        phrase = wording.choose(INTO[of["into"]])
        words[-1] += f", {phrase}" if phrase.startswith("entering") else f" {phrase}"
    return words


def instruction_of(said: Sequence[Leg], detail: Detail, random: Random) -> str:
    """Returns an instruction for legs that were rounded to `detail`. `random` selects the words."""
    wording = WordChoice(random)
    sentences: list[str] = []
    link = ""
    by = sorted((cue for cue in said[-1].cues if cue.kind == "by"), key=lambda cue: (cue.side == "", cue))
    last = by[0] if by and said[-1].meters is not None else None
    if last is not None:
        *before, leg = said
        said = [*before, replace(leg, cues=leg.cues - {last})]
    for leg in said:
        link = wording.choose([other for other in _LINKS if other != link or not link]) if sentences else ""
        both = wording.choose(_BOTH[:1] if link == "then " else _BOTH)
        sentences.append(sentence(link + _clause(leg, detail, both, wording)))
    end = wording.choose(ENDS) if last is None else stop_words(last, wording)
    return " ".join([*sentences, end])


def _clause(leg: Leg, detail: Detail, both: str, wording: WordChoice) -> str:
    """Returns the turn and the walk, joined by the pattern `both`, and the cues."""
    turn, seen = _turn_words(leg, detail, wording), cue_words(sorted(leg.cues), wording)
    if leg.meters is None:
        walk = wording.choose(ON_PHRASES[leg.slope])
    else:
        walk = wording.choose(WALK_PHRASES[leg.slope]).format(meter_words(leg.meters, wording))
    ahead = "" if turn else f" {wording.choose(AHEAD_PHRASES)}"
    walk = walk.replace("*", ahead) if "*" in walk else walk + ahead
    if seen:
        clause = leg.meters is not None or seen.startswith(("leaving", "following"))
        clause = clause or (not turn and leg.slope != "level")
        walk = f"{walk}, {seen}" if clause else f"{walk} {seen}"
    return both.format(turn, walk) if turn else walk


def _turn_words(leg: Leg, detail: Detail, wording: WordChoice) -> str:
    return turn_words(leg, detail, wording, DEGREE_PHRASES, CLOCK_PHRASES, TURN_PHRASES)


def meter_words(meters: float, wording: WordChoice) -> str:
    """Returns the words for a distance in meters."""
    if meters == 0.5:
        return wording.choose(HALF_METER)
    if meters == 1:
        return wording.choose(ONE_METER)
    return wording.choose(METER_PHRASES, f"{meters:g}")


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
    wording = WordChoice(random)
    found = [(text, 0) for text in _begin(views[0], wording)]
    for i, leg in enumerate(said):
        opener = wording.choose(_OPENERS) if i else ""
        turn = _turn_words(leg, detail, wording)
        seen = [cue for cue in views[i + 1].objects if cue.side == "ahead"]
        if turn:
            found.append((sentence(opener + turn), i))
            opener = ""
            if seen:
                found.append((sentence(wording.choose_about(_VIEW["ahead"], seen[0])), i))
        last = i + 1 == len(said)
        by = (
            next((cue for cue in sorted(leg.cues, key=lambda c: c.side == "") if cue.kind == "by"), None)
            if last
            else None
        )
        found.append((sentence(opener + _walk_clause(leg, by, not turn, wording)), i))
        into = [cue.subject for cue in leg.cues if cue.kind == "into"]
        if into:
            found.append(
                (
                    sentence(wording.choose(_NOW).format(wording.choose(_PLACES[into[0]]))),
                    i + 1,
                )
            )
        if by is not None:
            found.append((sentence(wording.choose_about(_STAND[by.side], by)), i + 1))
    found.append((sentence(wording.choose(_ENDS)), len(said)))
    return found


def _begin(view: View, wording: WordChoice) -> list[str]:
    """Returns the sentences about the start."""
    ahead = [cue for cue in view.objects if cue.side == "ahead"]
    place = wording.choose(_PLACES[view.kind])
    found = []
    if place or ahead:
        facing = wording.choose_about(_FACING, ahead[0]) if ahead else ""
        words = wording.choose(_BEGIN, place).rstrip()
        found.append(sentence(f"{words}, {facing}" if facing else words))
    for side in ("left", "right"):
        beside = [cue for cue in view.objects if cue.side == side and cue not in ahead]
        if beside and wording.random.random() < 0.7:
            found.append(sentence(wording.choose_about(_SIDES[side], beside[0]).replace("  ", " ")))
    return found


def _walk_clause(leg: Leg, by: Cue | None, straight: bool, wording: WordChoice) -> str:
    cues = sorted(leg.cues - ({by} if by is not None else set()))
    if leg.meters is None:
        walk = wording.choose(ON_PHRASES[leg.slope])
    else:
        walk = wording.choose(WALK_PHRASES[leg.slope], meter_words(leg.meters, wording))
    walk = walk.replace("*", "")
    walk += " straight ahead" if straight and leg.slope == "level" else ""
    said = cue_words(cues, wording)
    return f"{walk}, {said}" if said else walk
