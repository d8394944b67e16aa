"""Answers that must make sense: JSON is read out of what a model says, and the model is told what is wrong with it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from nvsim.endpoint.client import Client
from nvsim.endpoint.request import Request

T = TypeVar("T")
ASKED = 3
"""How often a question is asked until its answer makes sense."""
_BEGINNINGS = 100  # brackets at which an object is looked for
_LONGEST = 4000  # letters of a senseless answer that are said back


class Senseless(Exception):
    """An answer that makes no sense; the message says what is wrong, to the model."""


@dataclass(frozen=True)
class Unanswered:
    """why, whether the model refused, and what it cost: tokens in and out."""

    why: str
    refused: bool = False
    spent: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Understood(Generic[T]):
    """value: what the answer says; spent: tokens in and out."""

    value: T
    spent: tuple[int, int]


def ask_until_clear(
    client: Client, request: Request, understand: Callable[[str], T], again: Callable[[str], str]
) -> Understood[T] | Unanswered:
    """What `understand` makes of the answer. Where it raises Senseless the model is asked again, in words that `again`
    makes of what is wrong. A refusal is taken as it is.

    The question that follows holds what was said before, so that each has an answer of its own that is kept."""
    why, spent = "", (0, 0)
    for _ in range(ASKED):
        answer = client.ask(request)
        spent = spent[0] + answer.tokens_in, spent[1] + answer.tokens_out
        if answer.refusal:
            return Unanswered(f"it refused ({answer.refusal[:200]})", True, spent)
        try:
            return Understood(understand(answer.text), spent)
        except Senseless as senseless:
            why = str(senseless)
            if answer.cut_off:
                why = f"the answer was cut off after {request.tokens} tokens"
                if not answer.text:  # it was all spent on thinking, and would be again
                    return Unanswered(f"{why}, before it began; give more with --answer-tokens", False, spent)
        request = request.and_then(answer.text[:_LONGEST] or "(nothing)", again(why))
    return Unanswered(why, False, spent)


def json_object(text: str) -> dict[str, Any]:
    """The first JSON object in a text, which may stand in a fence or among words. Raises Senseless."""
    decoder, begin = json.JSONDecoder(), text.find("{")
    for _ in range(_BEGINNINGS):
        if begin < 0:
            break
        try:
            found, _ = decoder.raw_decode(text, begin)
        except (ValueError, RecursionError):
            found = None
        if isinstance(found, dict):
            return found
        begin = text.find("{", begin + 1)
    raise Senseless("there was no JSON object in the answer")
