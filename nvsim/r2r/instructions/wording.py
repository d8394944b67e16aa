"""Words for legs. Each phrase stands for one fact, so that who knows the phrases can read the facts back."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

from nvsim.r2r.instructions.ground import Leg, Slope
from nvsim.r2r.instructions.rounding import Detail, degrees_of, hour_of, turn_of

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
"""After the walk, in place of a turn."""
CLOCK_PHRASES = ("turn to {} o'clock", "face {} o'clock", "turn towards {} o'clock")
DEGREE_PHRASES = ("turn {} degrees to the {}", "turn {} degrees {}", "make a turn of {} degrees to the {}")
WALK_PHRASES: dict[Slope, tuple[str, ...]] = {
    "level": ("walk {}", "go {}", "move forward {}", "advance {}"),
    "up": ("go up for {}", "climb for {}", "walk up for {}"),
    "down": ("go down for {}", "descend for {}", "walk down for {}"),
}
METRE_PHRASES = ("{} metres", "about {} metres", "roughly {} metres", "some {} metres")
ONE_METRE = ("one metre", "about one metre", "a single metre")
_LINKS = ("", "then ", "next, ", "after that, ", "now ")
_BOTH = ("{} and {}", "{}, then {}", "{} and then {}")
_ENDS = ("Stop there.", "Stop.", "You have arrived.", "Wait there.", "That is the place.")


def instruction_of(said: Sequence[Leg], detail: Detail, random: Random) -> str:
    """An instruction for legs that were rounded to `detail`, in words that `random` chooses."""
    sentences: list[str] = []
    link = ""
    for leg in said:
        link = _of([other for other in _LINKS if other != link or not link], random) if sentences else ""
        both = _of(_BOTH[:1] if link == "then " else _BOTH, random)
        sentences.append(_sentence(link + _clause(leg, detail, both, random)))
    return " ".join([*sentences, _of(_ENDS, random)])


def _clause(leg: Leg, detail: Detail, both: str, random: Random) -> str:
    """Turn and walk, joined as `both` says."""
    walk = _of(WALK_PHRASES[leg.slope], random).format(_metres(leg.metres, random))
    turn = _turn(leg, detail, random)
    return both.format(turn, walk) if turn else f"{walk} {_of(AHEAD_PHRASES, random)}"


def _turn(leg: Leg, detail: Detail, random: Random) -> str:
    """ "" for no turn."""
    if detail == "degrees":
        degrees = degrees_of(leg)
        side = "right" if degrees > 0 else "left"
        return _of(DEGREE_PHRASES, random).format(abs(degrees), side) if degrees else ""
    if detail == "clock":
        hour = hour_of(leg)
        return "" if hour == 12 else _of(CLOCK_PHRASES, random).format(hour)
    turn = turn_of(leg)
    return "" if turn == "ahead" else _of(TURN_PHRASES[turn], random)


def _metres(metres: float, random: Random) -> str:
    if metres == 1:
        return _of(ONE_METRE, random)
    return _of(METRE_PHRASES, random).format(f"{metres:g}")


def _sentence(words: str) -> str:
    return words[0].upper() + words[1:] + "."


def _of(phrases: Sequence[str], random: Random) -> str:
    return phrases[int(random.random() * len(phrases))]
