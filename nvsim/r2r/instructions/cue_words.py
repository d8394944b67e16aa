"""Words for the cues along a leg. Each phrase has one meaning, so it can be parsed back to the cue."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import Protocol

from nvsim.r2r.instructions.cues import Cue

THINGS: dict[str, tuple[str, ...]] = {
    "tall": ("tall {} piece of furniture", "tall piece of {} furniture"),
    "waist-high": ("waist-high {} piece of furniture", "waist-high piece of {} furniture"),
    "low": ("low {} piece of furniture", "low piece of {} furniture"),
    "sofa": ("{} sofa", "{} couch"),
    "table": ("{} table",),
    "platform": ("low {} platform", "flat {} platform"),
    "object": ("{} object", "{} thing"),
}
"""Shape -> phrases for an object of a color."""
PAST = {
    "left": ("past the {} on your left", "with the {} on your left", "keeping the {} on your left"),
    "right": ("past the {} on your right", "with the {} on your right", "keeping the {} on your right"),
}
BY = {
    "left": ("until the {} is to your left", "until the {} is next to you on the left"),
    "right": ("until the {} is to your right", "until the {} is next to you on the right"),
    "ahead": ("until you stand before the {}", "until the {} is right in front of you", "up to the {} in front of you"),
}
STOP_BY = {
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
ALONG = ("along the corridor", "down the hallway", "following the corridor")
FLOOR = (
    "from the {0} floor onto the {1} one",
    "to where the floor changes from {2} to {3}",
    "to where the {0} floor gives way to a {1} one",
)
"""0, 1: adjectives of the two floors; 2, 3: their materials."""
_OF = {"wooden": "wood", "tiled": "tiles"}
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


class Chooser(Protocol):
    """Selects one of several phrases."""

    def __call__(self, phrases: Sequence[str], random: Random) -> str: ...


def cue_words(cues: Sequence[Cue], choose: Chooser, random: Random) -> str:
    """Returns the words for cues within a sentence, "" if there are no cues."""
    said = [*_doors(cues, choose, random)]
    for cue in sorted(cues):
        if cue.kind == "along":
            said.append(choose(ALONG, random))
        elif cue.kind == "floor":
            said.append(choose(FLOOR, random).format(*_floors(cue)))
        elif cue.kind == "rug":
            how, _, rug = cue.what.partition(" ")
            said.append(choose(RUG[how], random).format(rug))
    said += [choose(STAIRS[c.what], random) for c in sorted(cues) if c.kind == "stairs"]
    said += [choose(TO_STAIRS[c.what], random) for c in sorted(cues) if c.kind == "to stairs"]
    said += [choose(PAST[c.side], random).format(_thing(c, choose, random)) for c in sorted(cues) if c.kind == "past"]
    said += [choose(BY[c.side], random).format(_thing(c, choose, random)) for c in sorted(cues) if c.kind == "by"]
    return ", ".join(said)


def stop_words(cue: Cue, choose: Chooser, random: Random) -> str:
    """Returns the last sentence, for a path that ends next to an object."""
    return choose(STOP_BY[cue.side], random).format(_thing(cue, choose, random))


def _floors(cue: Cue) -> list[str]:
    names = cue.what.split(" to ")
    return [*names, *(_OF.get(name, name) for name in names)]


def _doors(cues: Sequence[Cue], choose: Chooser, random: Random) -> Sequence[str]:
    of = {cue.kind: cue.what for cue in cues}
    if "through" not in of:
        return []
    words = [choose(THROUGH[of["through"]], random)]
    if "out of" in of:
        phrase = choose(OUT_OF[of["out of"]], random)
        # "leaving the room" is a separate clause; "out of the room" comes before the doorway.
        words = [phrase, words[0]] if phrase.startswith("leaving") else [f"{phrase} {words[0]}"]
    if "into" in of:
        phrase = choose(INTO[of["into"]], random)
        words[-1] += f", {phrase}" if phrase.startswith("entering") else f" {phrase}"
    return words


def _thing(cue: Cue, choose: Chooser, random: Random) -> str:
    colour, _, shape = cue.what.partition(" ")
    return choose(THINGS[shape], random).format(colour)
