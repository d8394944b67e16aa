"""Words of the short register: about 25 words, no meters, and a landmark in every leg, as people write in R2R."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from random import Random

from nvsim.r2r.instructions.cues import Cue
from nvsim.r2r.instructions.ground import PACE, RISER, Detail, Leg
from nvsim.r2r.instructions.phrases import (
    CORRIDOR,
    DOOR,
    NUMBERS,
    WordChoice,
    alternatives_pattern,
    sentence,
    turn_words,
)

_GO = "[walk|walk|go|go|head|continue|move|proceed|keep going|make your way|start walking|travel|carry on]"
_STEP = "[walk|walk|go|go|head|step|move|pass|continue|proceed]"
_NEXT = "[next|next|next|other|adjacent|adjoining]"
_OUT = "[walk|go|head|step|move|come]"
WALKS: dict[str, str] = {
    "forward": alternatives_pattern("""
        [walk|go|head|move|continue|keep going|proceed] [forward|straight|straight ahead|ahead|straight on] | keep
        walking | continue on | keep going | walk on | keep moving | keep straight | go directly ahead | follow the
        path ahead | continue in the same direction | go straight forward | simply walk straight | walk further |
        move onward | stay straight | keep heading
        forwards"""),
    "room": alternatives_pattern("""
        cross the room | walk across the room | go across the room | head across the room | make your way across
        the room | walk to the [other|far|opposite] side of the room | cross the entire room | cross over to the
        far end of the room | go all the way across | walk the length of the room | walk across the floor"""),
    "corridor": alternatives_pattern(f"""
        [walk|go|head|continue|move|proceed|travel] [down|along] the {CORRIDOR} | follow the {CORRIDOR} | keep going
        down the {CORRIDOR} | go straight down the {CORRIDOR} | keep following the {CORRIDOR} | walk the
        whole length of the {CORRIDOR}"""),
    "1": alternatives_pattern(f"""
        {_STEP} through the {DOOR} | {_STEP} through the {DOOR} | [use|take] the {DOOR} | go on through the {DOOR}"""),
    "2": "[walk|go|pass|head|continue] through [two|both] [doorways|doors]",
    "out room": alternatives_pattern(f"""
        [exit|leave] [the|this] room | [exit|leave] the room | {_OUT} out of the room | [exit|leave] the room
        [through|by|via] the {DOOR} | get out of the room | go out the {DOOR} of the room"""),
    "out corridor": alternatives_pattern(f"""
        [exit|leave] the {CORRIDOR} [through|by|via] the {DOOR} | {_OUT} out of the {CORRIDOR}"""),
    "into room": alternatives_pattern(f"""
        enter the {_NEXT} room | step inside the {_NEXT} room | {_OUT} into the {_NEXT} room | {_STEP} through
        the {DOOR} into the {_NEXT} room"""),
    "into corridor": alternatives_pattern(f"""
        enter the {CORRIDOR} | {_OUT} into the {CORRIDOR} | {_STEP} through the {DOOR} into the {CORRIDOR}"""),
    "room to corridor": alternatives_pattern(f"""
        [exit|leave] the room into the {CORRIDOR} | {_OUT} out of the room into the {CORRIDOR} | leave the room
        and enter the {CORRIDOR} | {_OUT} out into the {CORRIDOR} from the room"""),
    "room to room": alternatives_pattern(f"""
        {_OUT} out of the room into the {_NEXT} one | leave the room and enter the {_NEXT} one | {_OUT} from
        this room into the {_NEXT} one"""),
    "corridor to room": alternatives_pattern(f"""
        [leave|exit] the {CORRIDOR} and enter the room | {_OUT} out of the {CORRIDOR} into the room | leave the
        {CORRIDOR} for the room | {_OUT} from the {CORRIDOR} into the room"""),
    "up": alternatives_pattern("""
        go up the stairs | walk up the stairs | climb the stairs | head up the stairs | take the stairs up | go
        upstairs | ascend the stairs | go up the staircase | climb up the steps | go up one flight"""),
    "down": alternatives_pattern("""
        go down the stairs | walk down the stairs | descend the stairs | head down the stairs | take the stairs
        down | go downstairs | go down the staircase | go down the steps | go down one flight |
        carefully walk down the stairs"""),
}
"""Imperatives: of a walk without a landmark, along a corridor or a room, through doorways, and on stairs."""
TOWARDS = alternatives_pattern(f"""
    {_GO} [toward|towards] the {{}} | {_GO} in the direction of the {{}} | head for the {{}} | approach the {{}}
    | move closer to the {{}} | keep the {{}} straight ahead | find the {{}} and head that way | go over toward
    the {{}} | notice the {{}} and walk toward it | aim for the {{}}""")
_SIDE = "[on your left|on the left|to your left|on your left side|on the left-hand side]"
PASSING = {
    "": alternatives_pattern("""
        pass the {} | walk past the {} | go past the {} | continue past the {} | walk by the {} | go by the {} |
        move past the {} | leave the {} behind you | walk right past the {} | you will pass the {} | ignore the
        {} and keep going | go beyond the {} | pass alongside the {} | pass by the {}"""),
    "left": alternatives_pattern(f"""
        [walk|go|head|continue|move|keep going] past the {{}} {_SIDE} | you will pass the {{}} {_SIDE}"""),
}
PAST = {
    "": "[past the {}|passing the {}|going past the {}|going by the {}|leaving the {} behind|walking by the {}]",
    "left": alternatives_pattern(f"""
        past the {{}} {_SIDE} | passing the {{}} {_SIDE} | with the {{}} on your left | keeping the {{}} on your
        left | so that the {{}} is on your left"""),
}
"""Of an object beside the way: as an imperative, and after another walk."""
UNTIL = {
    "": alternatives_pattern("""
        until you [reach|get to|come to|are near|are close to|arrive at|are next to] the {} | as far as the {} | all
        the way to the {} | until you're beside the {} | up to the {}"""),
    "left": "until the {} is [on|to] your left",
    "ahead": "[until you face the {}|until you are in front of the {}|right up to the {}|until you meet the {}]",
}
AT = alternatives_pattern("""
    at the {} | when you reach the {} | once you reach the {} | when you get to the {} | near the {} | upon
    arriving at the {} | as soon as you reach the {} | after reaching the {} | once you arrive at the {} | close to
    the {} | when you come to the {} | right at the {} | beside the {}""")
"""Before the turn after the leg."""
_HALT = "[stop|stop|stop|wait|wait|stand|pause|end|stay|remain|finish]"
WALK_TO = "[walk|go|head|move|continue|proceed|walk over|go over|come] to the {}"
"""To an object at the end of the path, before the stop."""
STOP_BY = {
    "": alternatives_pattern(f"""
        {_HALT} [by|next to|beside|near|close to|at|alongside|adjacent to] the {{}} | {_HALT} [by|next
        to|beside|near|close to] the {{}} | {_HALT} [by|next to|near] the {{}} | come to a stop [near|by] the
        {{}} | your goal is near the {{}} | stop just short of the {{}} | stop right by the {{}} | stop right
        next to the {{}} | finish up near the {{}} | you should end up by the {{}} | stop in the area by the {{}}
        | the {{}} is your stopping point | don't go further than the {{}} | stop within a step of the {{}} |
        stop about two feet from the {{}} | stop once you've reached the {{}}"""),
    "left": alternatives_pattern(f"""
        {_HALT} [with the {{}} on your left|with the {{}} to your left] | {_HALT} [once|when] the {{}} is on your
        left | stop so that the {{}} is on your left"""),
    "ahead": alternatives_pattern(f"""
        {_HALT} [in front of|before|facing] the {{}} | stop right in front of the {{}} | {_HALT} directly before
        the {{}}"""),
}
for _table in (PASSING, PAST, UNTIL, STOP_BY):
    _table["right"] = _table["left"].replace("left", "right")
STOPS = alternatives_pattern("""
    [stop|wait|stay|end|pause|remain|finish] there | stop | stop | [stop|wait] here | come to a stop | that is
    your destination | you have arrived | you are there | stop at that point | this is the goal | you've arrived
    | stand still | stay put | you're done | you made it | stop moving | stop right there | this is the spot |
    you're there | stop at this location | that's it | that's your destination | rest here | you're finished |
    that's all | you've reached your target | don't go any further | this is the place""")
RUG = {
    "onto": "[step onto the {}|walk onto the {}|move onto the {}]",
    "off": "[step off the {}|walk off the {}|move off the {}]",
    "across": "[walk over the {}|cross the {}|walk across the {}|go over the {}]",
}
FLOOR = alternatives_pattern("""
    step from the {0} floor onto the {1} one | leave the {0} flooring for the {1} one | cross from the {0} floor
    to the {1} floor | walk to where the {0} floor meets the {1} one | go from the {0} floor to the {1} one""")
STAIRS = {"top": "[to the top|all the way up]", "bottom": "[to the bottom|all the way down]"}
TO_STAIRS = {
    "up": "[to the foot of the stairs|to where the stairs lead up]",
    "down": "[to the top of the stairs|to where the stairs lead down]",
}
ROUGHLY = {
    1.0: "[a step or two|one or two steps|just a step or two]",
    2.5: "[a few steps|some steps|a little way|a couple of steps|a handful of steps]",
    5.0: "[several steps|a short distance|a fair bit|a short way|a number of steps]",
    10.0: "[a long way|quite far|a good distance|pretty far|a long distance]",
}
_FORWARD = alternatives_pattern(
    "walk {} | go {} | go forward {} | move forward {} | walk {} ahead | walk straight {} | continue {}"
)
_FIRST = (
    *[""] * 12,
    "first, ",
    "to begin, ",
    "to start, ",
    "starting out, ",
    "initially, ",
)
_OPENERS = (
    *[""] * 12, "then ", "next, ", "after that, ", "from there, ", "now ", "afterwards, ", "once there, ",
    "afterward, ", "at that point, ", "from here, ", "immediately ", "here, ", "shortly after, ", "later, ",
)  # fmt: skip
_LAST = (
    *[""] * 6,
    "then ",
    "then ",
    "finally, ",
    "lastly, ",
    "there, ",
    "to finish, ",
    "in the end, ",
    "at last, ",
)
_NO_OPENER = ("at", "when", "once", "near", "close", "upon", "as", "after", "that", "this", "you", "your", "the")
_MOST_IN_WORDS = 10  # largest number of steps that is written as a word
_MOST_WORDS = 16  # largest number of words of a sentence with several clauses


@dataclass(frozen=True)
class _Clause:
    """A clause; `opens` if it can only begin a sentence."""

    words: str
    opens: bool = False


def short_instruction(said: Sequence[Leg], detail: Detail, random: Random) -> str:
    """Returns an instruction of the short register for legs that were rounded to `detail`."""
    wording = WordChoice(random)
    clauses: list[_Clause] = []
    reached: Cue | None = None
    for i, leg in enumerate(said):
        by = next((cue for cue in sorted(leg.cues) if cue.kind == "by"), None)
        turn = turn_words(leg, detail, wording)
        if reached is not None:
            clauses.append(_Clause(f"{wording.choose_about(AT, reached)}, {turn}", opens=True))
        elif turn:
            clauses.append(_Clause(turn))
        reached = None
        is_last = i + 1 == len(said)
        follows = not is_last and turn_words(said[i + 1], detail, WordChoice(Random(0))) != ""
        if by is not None and by.side == "" and follows and wording.random.random() < 0.6:
            reached = by
        inside = leg if by is None or not (is_last or reached is by) else replace(leg, cues=leg.cues - {by})
        is_plain = is_last and by is not None and not inside.cues and leg.meters is None
        if by is not None and is_plain and by.side in ("", "ahead") and wording.random.random() < 0.5:
            clauses += [_Clause(wording.choose_about(WALK_TO, by))]
            by = None
        else:
            clauses += [_Clause(words) for words in _walk_phrases(inside, wording)]
        if is_last:
            words = wording.choose(STOPS) if by is None else wording.choose_about(STOP_BY[by.side], by)
            clauses.append(_Clause(words))
    return _sentences(clauses, wording)


def _sentences(clauses: Sequence[_Clause], wording: WordChoice) -> str:
    sentences: list[str] = []
    group: list[str] = []
    size = 2 + int(wording.random.random() * 2)
    for clause in clauses:
        count = sum(len(words.split()) for words in (*group, clause.words))
        if group and (clause.opens or len(group) >= size or count > _MOST_WORDS):
            sentences.append(_join_clauses(group, bool(sentences), False, wording))
            group, size = [], 2 + int(wording.random.random() * 2)
        group.append(clause.words)
    sentences.append(_join_clauses(group, bool(sentences), True, wording))
    return " ".join(sentences)


def _join_clauses(group: Sequence[str], follows: bool, ends: bool, wording: WordChoice) -> str:
    *first, last = group
    openers = _FIRST if not follows else _LAST if ends else _OPENERS
    opener = "" if group[0].split(" ")[0] in _NO_OPENER else wording.choose(openers)
    if not first:
        return sentence(opener + last)
    alone = last.split(" ")[0] in _NO_OPENER
    links = (" and ",) if opener in ("then ", "next, ") else (" and ", ", then ", " and then ", " and ")
    link = ", and " if len(group) > 2 or alone else wording.choose(links)
    return sentence(opener + ", ".join(first) + link + last)


def _walk_phrases(leg: Leg, wording: WordChoice) -> list[str]:
    """Returns the imperatives of a walk with its landmarks, in the order of the way."""
    door = min((cue.distance for cue in leg.cues if cue.kind in ("through", "rug", "floor")), default=float("inf"))
    found: list[str] = []
    past = sorted((cue for cue in leg.cues if cue.kind == "past"), key=lambda cue: cue.distance)
    early = [cue for cue in past if cue.distance < door]
    late = [cue for cue in past if cue.distance >= door]
    main = _landmark_phrase(leg, wording)
    far = _distance(leg, wording)
    if main:
        found += [wording.choose_about(PASSING[cue.side], cue) for cue in early if door < float("inf")]
        late = late if door < float("inf") else past
        found.append(main)
        found[-1] += "".join(f", {wording.choose_about(PAST[cue.side], cue)}" for cue in late)
    elif past:
        found += [wording.choose_about(PASSING[cue.side], cue) for cue in past]
    else:
        found.append(wording.choose(_FORWARD if far else WALKS["forward"], far))
    if far and (main or past):
        is_plain = door == float("inf") and leg.slope == "level" and not past
        found[-1] += f" for {far}" if is_plain else f", {far} {wording.choose('[in all|in total|altogether|overall]')}"
    tail = [wording.choose(STAIRS[c.subject]) for c in sorted(leg.cues) if c.kind == "stairs"]
    tail += [wording.choose(TO_STAIRS[c.subject]) for c in sorted(leg.cues) if c.kind == "to stairs"]
    tail += [wording.choose_about(UNTIL[c.side], c) for c in sorted(leg.cues) if c.kind == "by"]
    found[-1] = " ".join([found[-1], *tail])
    return found


def _landmark_phrase(leg: Leg, wording: WordChoice) -> str:
    """Returns the imperative of the main landmark: stairs, doorway, floor, corridor, object ahead; "" without one."""
    if leg.slope != "level":
        return wording.choose(WALKS[leg.slope])
    of: dict[str, Cue] = {cue.kind: cue for cue in sorted(leg.cues) if cue.kind not in ("past", "by")}
    words = []
    if "through" in of:
        words.append(wording.choose(WALKS[_doorway_key(of)]))
    if "rug" in of:
        how, _, rug = of["rug"].subject.partition(" ")
        words.append(wording.choose(RUG[how], rug))
    if "floor" in of:
        words.append(wording.choose(FLOOR, *of["floor"].subject.split(" to ")))
    if "along" in of:
        words.append(wording.choose(WALKS[of["along"].subject]))
    if "towards" in of:
        words.append(wording.choose_about(TOWARDS, of["towards"]))
    return " and ".join(words[:2])


def _doorway_key(of: dict[str, Cue]) -> str:
    """Returns the key in WALKS for the doorway with the rooms before and after it."""
    out, into = (of[kind].subject if kind in of else "" for kind in ("out of", "into"))
    if (out, into) == ("corridor", "corridor"):
        return "out corridor"
    if out and into:
        return f"{out} to {into}"
    return f"out {out}" if out else f"into {into}" if into else of["through"].subject


def _distance(leg: Leg, wording: WordChoice) -> str:
    """Returns the distance in paces or rough words, "" if it is not mentioned."""
    if leg.meters is None:
        return ""
    if leg.measure == "roughly":
        return wording.choose(ROUGHLY[leg.meters])
    count = round(leg.meters / (PACE if leg.slope == "level" else RISER))
    number = NUMBERS[count] if count <= _MOST_IN_WORDS else str(count)
    return f"{number} step{'s' if count > 1 else ''}"
