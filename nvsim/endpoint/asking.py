"""Parse answers, ask the model again if an answer cannot be parsed, and ask several questions in parallel."""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from nvsim.endpoint.client import Client
from nvsim.endpoint.request import Request

T = TypeVar("T")
ASKED = 3
"""How many times a model is asked for an answer that can be parsed."""
_BEGINNINGS = 100  # opening braces at which a JSON object is tried
_LONGEST = 4000  # characters of an unusable answer that are sent back


class UnusableAnswer(Exception):
    """An answer cannot be parsed. The message tells the model why."""


@dataclass(frozen=True)
class MissingAnswer:
    """No usable answer: the reason, whether the model refused, and the tokens spent (input, output)."""

    why: str
    refused: bool = False
    spent: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class ParsedAnswer(Generic[T]):
    """A parsed answer, and the tokens spent (input, output)."""

    value: T
    spent: tuple[int, int]


def ask_until_clear(
    client: Client, request: Request, understand: Callable[[str], T], again: Callable[[str], str]
) -> ParsedAnswer[T] | MissingAnswer:
    """Asks the model, and parses its answer with `understand`. If `understand` raises UnusableAnswer, the model is
    asked again with the text that `again` makes of the reason, up to ASKED times. A refusal is not asked again.

    Each follow-up request contains the conversation so far, so its answer is stored separately."""
    why, spent = "", (0, 0)
    for _ in range(ASKED):
        answer = client.ask(request)
        spent = spent[0] + answer.tokens_in, spent[1] + answer.tokens_out
        if answer.refusal:
            return MissingAnswer(f"it refused ({answer.refusal[:200]})", True, spent)
        try:
            return ParsedAnswer(understand(answer.text), spent)
        except UnusableAnswer as unusable:
            why = str(unusable)
            if answer.cut_off:
                why = f"the answer was cut off after {request.tokens} tokens"
                if not answer.text:  # the model spent all tokens on thinking, and would do so again
                    return MissingAnswer(f"{why}, before any text; raise the limit with --answer-tokens", False, spent)
        request = request.and_then(answer.text[:_LONGEST] or "(nothing)", again(why))
    return MissingAnswer(why, False, spent)


def json_object(text: str) -> dict[str, Any]:
    """The first JSON object in a text, which may also contain prose or a code fence. Raises UnusableAnswer if it has
    none."""
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
    raise UnusableAnswer("there was no JSON object in the answer")


R = TypeVar("R")
_GRACE = 5.0  # seconds that running requests have to finish when the caller stops


def run_in_parallel(work: Callable[[T], R], items: Sequence[T], at_once: int) -> Iterator[tuple[T, R]]:
    """Yields every item with the result of `work` on it, in the order of completion. If `work` raises an error, no
    other item is started, running ones finish, and the error is raised. If the caller stops, running ones have a few
    seconds to finish."""
    waiting: queue.SimpleQueue[T] = queue.SimpleQueue()
    done: queue.SimpleQueue[tuple[T, R] | BaseException | None] = queue.SimpleQueue()
    stopped = threading.Event()
    for item in items:
        waiting.put(item)

    def worker() -> None:
        while not stopped.is_set():
            try:
                item = waiting.get_nowait()
            except queue.Empty:
                break
            try:
                done.put((item, work(item)))
            except BaseException as error:
                stopped.set()
                done.put(error)
        done.put(None)

    threads = [threading.Thread(target=worker, daemon=True) for _ in range(min(at_once, len(items)))]
    for thread in threads:
        thread.start()
    failed: BaseException | None = None
    left = len(threads)
    try:
        while left:
            found = done.get()
            if found is None:
                left -= 1
            elif isinstance(found, BaseException):
                failed = failed or found
            else:
                yield found
    finally:
        stopped.set()
        until = time.monotonic() + _GRACE
        for thread in threads:
            thread.join(max(0.0, until - time.monotonic()))
    if failed is not None:
        raise failed
