"""Alternatives of phrases, the names of objects, and the vocabulary that the registers share.

A pattern contains alternatives in brackets: "[walk|go] to the [sofa|couch]". Each phrase has one meaning, so it can be
parsed back to the facts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from random import Random

from nvsim.r2r.instructions.cues import Cue
from nvsim.r2r.instructions.ground import Detail, Leg, clock_hour, degrees_of, rounded_turn


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
"""Shape -> pattern for an object of a color. Other names stand behind the color."""
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


def _choose_alternatives(pattern: str, random: Random) -> str:
    """Returns a pattern with one of each of its alternatives. Alternatives may be nested."""
    while found := _ALTERNATIVES.search(pattern):
        pattern = pattern[: found.start()] + _one(found[1].split("|"), random) + pattern[found.end() :]
    return pattern


def plain_name(shape: str, color: str) -> str:
    """Returns the first name of an object of this shape and color ("" for none), without an article."""
    pattern = _ALTERNATIVES.sub(lambda found: found[1].split("|")[0], _pattern_of(shape))
    return " ".join(pattern.format(color).split())


def _pattern_of(shape: str) -> str:
    return THINGS.get(shape, f"{{}} {shape}")


def _one(phrases: Sequence[str], random: Random) -> str:
    return phrases[int(random.random() * len(phrases))]


def sentence(words: str) -> str:
    """Returns words as a sentence with a capital letter, a full stop, and the right indefinite articles."""
    words = _BEFORE_VOWEL.sub("an", words)
    return words[0].upper() + words[1:] + "."


class WordChoice:
    """Selects the words of one instruction at random. An object keeps its noun, and a second mention has no color."""

    def __init__(self, random: Random) -> None:
        self.random = random
        self._nouns: dict[str, str] = {}

    def choose(self, phrases: str | Sequence[str], *values: object) -> str:
        """Returns one of several phrases, or a pattern with one of each of its alternatives, with `values` in its
        fields."""
        chosen = _choose_alternatives(phrases, self.random) if isinstance(phrases, str) else _one(phrases, self.random)
        return chosen.format(*values) if values else chosen

    def choose_about(self, phrases: str | Sequence[str], cue: Cue) -> str:
        """Returns `choose` with the name of the object of a cue, without an article, in the field."""
        chosen = self.choose(phrases)
        color, _, shape = cue.subject.partition(" ")
        if cue.subject not in self._nouns:
            self._nouns[cue.subject] = _choose_alternatives(_pattern_of(shape), self.random)
        return chosen.format(" ".join(self._nouns[cue.subject].format(color).split()))


def turn_words(
    leg: Leg,
    detail: Detail,
    wording: WordChoice,
    degrees: str | Sequence[str] = DEGREES,
    clock: str | Sequence[str] = CLOCK,
    turns: Mapping[str, str | Sequence[str]] = TURNS,
) -> str:
    """Returns the phrase for the turn of a leg, "" if there is none."""
    if detail == "degrees":
        angle = degrees_of(leg)
        return wording.choose(degrees, abs(angle), "right" if angle > 0 else "left") if angle else ""
    if detail == "clock":
        hour = clock_hour(leg)
        return "" if hour == 12 else wording.choose(clock, hour)
    turn = rounded_turn(leg)
    return "" if turn == "ahead" else wording.choose(turns[turn])
