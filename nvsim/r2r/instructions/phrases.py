"""Alternatives of phrases, the names of objects, and the vocabulary that the registers share.

A pattern contains alternatives in brackets: "[walk|go] to the [sofa|couch]". Each phrase has one meaning, so it can be
parsed back to the facts.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from random import Random

from nvsim.r2r.instructions.cues import Cue


def alternatives_pattern(text: str) -> str:
    """Returns a pattern of the alternatives in a text, which "|" separates and which may fill several lines."""
    return "[" + re.sub(r"\s*\|\s*", "|", " ".join(text.split())) + "]"


def _mirror(left: str) -> str:
    return left.replace("left", "right")


THINGS: dict[str, str] = {
    "chair": "{} [chair|seat]",
    "plant": "[potted plant|{} plant|plant|houseplant|{} house plant|leafy {} plant|indoor plant]",
    "sofa": "{} [sofa|couch]",
    "desk": "{} [desk|desk|office desk|writing desk|work desk|study desk]",
    "table": "{} table",
    "low table": "[{} coffee table|low {} table]",
    "bookshelf": "[{} bookshelf|{} bookcase|{} shelf with books|{} shelving unit]",
    "cabinet": "{} [cabinet|cabinet|cupboard|storage cabinet|storage unit]",
    "box": "{} [box|box|crate|container|storage box]",
    "platform": "[low {} platform|flat {} platform|low {} stage|raised {} platform]",
    "tall": "tall {} [piece of furniture|unit]",
    "waist-high": "waist-high {} [piece of furniture|unit]",
    "low": "low {} [piece of furniture|unit]",
    "object": "{} [object|thing]",
}
"""Shape -> pattern for an object of a color."""
CORRIDOR = "[corridor|corridor|hallway|hallway|hall|passage|passageway|walkway|hall]"
DOOR = "[doorway|doorway|door|door|open door|door frame|entryway|opening|entrance]"
FLOOR_OF = {"wooden": "wood", "tiled": "tiles"}
"""Adjective of a floor -> its material."""
_SLIGHTLY = alternatives_pattern("""
    bear left | veer left | turn slightly left | turn a little left | angle left | curve left | go slightly left
    | veer to the left | make a slight left | take a slight left | go diagonally left | turn a bit left | keep
    left | stay left | shift left | ease left | take a gentle left | turn gently left | make an easy left""")
_LEFT = alternatives_pattern("""
    turn left | turn left | turn left | make a left | take a left | go left | turn to the left | make a left turn
    | turn to your left | hang a left | face left | head left | take a left turn | rotate left | swing left | cut
    left | look left and go that way | pivot left | hook a left""")
_SHARPLY = alternatives_pattern("""
    turn sharply left | make a sharp left | take a sharp left | turn hard left | turn far to the left | make a
    tight left turn | take a hard left | make a hard left | make a very sharp left""")
TURNS: dict[str, str] = {
    "slightly left": _SLIGHTLY,
    "left": _LEFT,
    "sharply left": _SHARPLY,
    "slightly right": _mirror(_SLIGHTLY),
    "right": _mirror(_LEFT),
    "sharply right": _mirror(_SHARPLY),
    "around": alternatives_pattern("""
        turn around | turn around | turn around | turn back | make a U-turn | turn completely around | spin
        around | face the opposite direction | turn to face the other way | make a half turn | go the opposite
        way | do a 180 | turn 180 degrees | turn all the way around | reverse direction | turn fully around |
        turn yourself around | make a full turn back | do an about-face | turn backwards"""),
}
"""Turn -> pattern of an imperative."""
CLOCK = "[turn to|face|turn towards] {} o'clock"
DEGREES = "[turn {0} degrees to the {1}|make a turn of {0} degrees to the {1}]"
NUMBERS = (
    "no",
    "one",
    "two",
    "three",
    "four",
    "five",
    "six",
    "seven",
    "eight",
    "nine",
    "ten",
    "eleven",
    "twelve",
    "thirteen",
    "fourteen",
    "fifteen",
    "sixteen",
)
_BEFORE_VOWEL = re.compile(r"\ba(?= [aeio])")
_ALTERNATIVES = re.compile(r"\[([^\[\]]*)\]")


def choose_alternatives(pattern: str, random: Random) -> str:
    """Returns a pattern with one of each of its alternatives. Alternatives may be nested."""
    while found := _ALTERNATIVES.search(pattern):
        pattern = pattern[: found.start()] + choose_phrase(found[1].split("|"), random) + pattern[found.end() :]
    return pattern


def plain_name(shape: str, color: str) -> str:
    """Returns the first name of an object of this shape and color, without an article. Raises KeyError if the shape is
    unknown."""
    pattern = _ALTERNATIVES.sub(lambda found: found[1].split("|")[0], THINGS[shape])
    return " ".join(pattern.format(color).split())


def choose_phrase(phrases: Sequence[str], random: Random) -> str:
    return phrases[int(random.random() * len(phrases))]


def sentence(words: str) -> str:
    """Returns words as a sentence with a capital letter, a full stop, and the right indefinite articles."""
    words = _BEFORE_VOWEL.sub("an", words)
    return words[0].upper() + words[1:] + "."


class ObjectNames:
    """Names the objects of one instruction: an object keeps its noun, and a second mention has no color."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._nouns: dict[str, str] = {}

    def name_of(self, cue: Cue) -> str:
        """Returns the name of the object of a cue, without an article."""
        color, _, shape = cue.subject.partition(" ")
        if cue.subject not in self._nouns:
            self._nouns[cue.subject] = choose_alternatives(THINGS[shape], self._random)
        return self._nouns[cue.subject].format(color)
