"""Ask one endpoint: each request is sent once, its answer is stored on disk, and failed requests are repeated.

Uses OpenAI's chat completions (https://platform.openai.com/docs/api-reference/chat), which most services and servers
support. Redirects are not followed, so images go only to the address that the user named.
"""

from __future__ import annotations

import json
import random
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import Any

from nvsim.endpoint.budget import Budget, tokens_in
from nvsim.endpoint.connection import LARGEST, Connection, NoReply, Reply, TooLarge
from nvsim.endpoint.options import AskingOptions, Endpoint
from nvsim.endpoint.request import MOST_TOKENS, Answer, Request, StoredAnswers
from nvsim.errors import InputError, value_text
from nvsim.events import Listener, Warning, ignore_event
from nvsim.files.opening import parse_json

_LONGEST_WAIT = 60.0  # seconds of our own backoff
_LONGEST_ASKED = 600.0  # seconds that an endpoint may ask NVSim to wait
_MOST_RESPELLED = 4  # two options, and changes by other threads in the meantime
_LATER = {408, 409, 425, 429}
_FILTERED = ("content_filter", "content_policy_violation", "ResponsibleAIPolicyViolation")


class Unreachable(InputError):
    """The endpoint gave no answer in all attempts."""


class Client:
    """Asks one model. Several threads may use it. Raises InputError if the package `httpx2` is not installed.

    may_send   whether the user agreed to send requests; until then only stored answers are available
    """

    def __init__(
        self,
        endpoint: Endpoint,
        kept: StoredAnswers,
        budget: Budget,
        options: AskingOptions,
        listen: Listener = ignore_event,
    ) -> None:
        self.endpoint, self.kept, self.budget, self.options = endpoint, kept, budget, options
        self.may_send = False
        budget.add_earlier_tokens(*kept.tokens_spent(endpoint.url, endpoint.model))
        self._listen = listen
        self._connection = Connection(endpoint.key, options.timeout)
        self._lock = threading.Lock()
        self._not_before = 0.0  # value of time.monotonic() at which the next request may be sent
        self._spelled = {"tokens": "max_tokens", "temperature": "temperature"}

    def has_stored_answer(self, request: Request) -> bool:
        """Whether the answer is stored, so that nothing would be sent."""
        return self.kept.get(self._key(request)) is not None

    def ask(self, request: Request) -> Answer:
        """The stored answer. If there is none, sends the request and stores its answer. A refusal is an answer.

        Raises InputError if the request must be sent but the user did not agree. Raises BudgetSpent if the budget is
        too small, and Unreachable after all attempts. Raises InputError if repeating cannot help: a wrong key, an
        unknown model, no credit, or a request that the endpoint rejects.
        """
        key = self._key(request)
        found = self.kept.get(key)
        if found is None:
            if not self.may_send:
                raise InputError("A request has no stored answer, and nothing was sent; give --yes to send it.")
            with self.budget.reserve(tokens_in(request), request.tokens):
                found = self._request_answer(request)
                self.kept.store(key, self.endpoint.url, self.endpoint.model, request, found)
                self.budget.count(found, tokens_in(request))
        else:
            self.budget.count_again()
        return found

    def _key(self, request: Request) -> str:
        return request.key(self.endpoint.url, self.endpoint.model)

    def _request_answer(self, request: Request) -> Answer:
        why = ""
        attempt = respelled = 0
        while attempt < self.options.attempts:
            self._wait_for_pause_end()
            try:
                return self._send_once(request)
            except _ParameterRenamed:  # repeated at once, with the endpoint's option names
                respelled += 1
                if respelled > _MOST_RESPELLED:
                    break
            except _RetryLater as later:
                why, attempt = str(later), attempt + 1
                if attempt < self.options.attempts:
                    self._pause(later.seconds, attempt, why)
        attempts = "1 attempt" if self.options.attempts == 1 else f"{self.options.attempts} attempts"
        raise Unreachable(
            f"{self.endpoint.url} gave no answer in {attempts} ({why}); answers so far are "
            "stored, so run the same command again later."
        )

    def _send_once(self, request: Request) -> Answer:
        spelled = dict(self._spelled)
        question: dict[str, Any] = {"model": self.endpoint.model, "messages": request.body()}
        question[spelled["tokens"]] = request.tokens
        if "temperature" in spelled:
            question["temperature"] = 0
        try:
            # Plain ASCII, because an answer that is sent back may contain halves of surrogate pairs.
            reply = self._connection.post(f"{self.endpoint.url}/chat/completions", json.dumps(question).encode())
        except NoReply as error:
            raise _RetryLater(str(error)) from error
        except TooLarge as error:
            raise InputError(
                f"{self.endpoint.url} sends an answer of more than {LARGEST >> 20} MB, which is not a model's answer; "
                "check --endpoint."
            ) from error
        if 200 <= reply.status < 300:
            return _read(reply.content, request)
        return self._handle_failure(reply, spelled, request)

    def _handle_failure(self, reply: Reply, spelled: Mapping[str, str], request: Request) -> Answer:
        """Handles an HTTP status that is not success. A content filter gives an answer that is a refusal. Everything
        else raises _Later, _Respelled, or InputError."""
        status, complaint = reply.status, _EndpointError.of(reply.content)
        said = complaint.said
        who = f"{self.endpoint.url} returned status {status}"
        if complaint.code == "insufficient_quota":
            raise InputError(f"{who}: this key has no credit left ({said}); top it up and run the command again.")
        if status in _LATER or status >= 500:
            raise _RetryLater(f"status {status}: {said}", _asked_for(reply.headers))
        if status in (401, 403):
            name = self.endpoint.variable
            raise InputError(f"{who}: the key in {name} is not accepted for {self.endpoint.model} ({said}); check it.")
        if status == 404:
            raise InputError(f"{who}: it has no model {self.endpoint.model} ({said}); check --endpoint and --model.")
        if 300 <= status < 400:
            to = value_text(reply.headers.get("location", "elsewhere"))
            raise InputError(f"{who}: it redirects to {to}; give that address as --endpoint if you trust it.")
        if status in (400, 422):
            if any(word in complaint.code or word in complaint.whole for word in _FILTERED):
                return Answer("", refusal=said or "a filter", tokens_in=tokens_in(request), counted=False)
            if self._adapt_option(f"{complaint.option} {complaint.whole}", spelled):
                raise _ParameterRenamed
        raise InputError(f"{who}, so it rejects this request: {said}.")

    def _adapt_option(self, complaint: str, spelled: Mapping[str, str]) -> bool:
        """Adapts an option that the endpoint rejects; returns whether the request is worth repeating. Newer OpenAI
        models reject max_tokens, older servers max_completion_tokens, and reasoning models temperature."""
        with self._lock:
            if spelled != self._spelled:
                return True  # another thread changed the options in the meantime
            if "temperature" in complaint and "temperature" in self._spelled:
                del self._spelled["temperature"]
                return True
            if "max_tokens" in complaint and self._spelled["tokens"] == "max_tokens":
                self._spelled["tokens"] = "max_completion_tokens"
                return True
            return False

    def _wait_for_pause_end(self) -> None:
        while (left := self._not_before - time.monotonic()) > 0:
            time.sleep(left)

    def _pause(self, asked: float | None, attempt: int, why: str) -> None:
        """Makes all threads wait: as long as the endpoint asks, else with exponential backoff and random jitter. Raises
        Unreachable if the endpoint asks for too long."""
        if asked is not None and asked > _LONGEST_ASKED:
            raise Unreachable(
                f"{self.endpoint.url} asks to wait {asked / 60:.0f} minutes ({why}); answers so far are stored, so run "
                "the same command again then."
            )
        own = min(self.options.first_wait * 2 ** (attempt - 1), _LONGEST_WAIT) * random.uniform(0.75, 1.25)
        seconds = own if asked is None else asked
        with self._lock:
            self._not_before = max(self._not_before, time.monotonic() + seconds)
        if seconds >= 5:
            self._listen(Warning(f"{self.endpoint.url}: next request in {seconds:.0f} seconds ({why}).", "endpoint"))

    def close(self) -> None:
        """Closes open connections."""
        self._connection.close()


class _RetryLater(Exception):
    def __init__(self, why: str, seconds: float | None = None) -> None:
        super().__init__(why)
        self.seconds = seconds


class _ParameterRenamed(Exception):
    pass


@dataclass(frozen=True)
class _EndpointError:
    """The error that an endpoint reports for a failed request.

    said     its message, in one line of at most 200 characters
    code     error code, "" if there is none
    option   the request option that it rejects, "" if none is named
    whole    the complete error text
    """

    said: str
    code: str
    option: str
    whole: str

    @staticmethod
    def of(content: bytes) -> _EndpointError:
        text = content.decode(errors="replace")
        try:
            body = _parse_json(text)
        except InputError:
            body = text
        error = body.get("error") or body if isinstance(body, dict) else body
        fields = error if isinstance(error, dict) else {}
        words = " ".join(str(fields.get("message") or error or "nothing").split())
        said = "".join(c if c.isprintable() else "?" for c in words[:200]).rstrip(".")
        return _EndpointError(said, str(fields.get("code") or ""), str(fields.get("param") or ""), str(error))


def _parse_json(text: str) -> Any:
    """Raises InputError if the text is not JSON, or is JSON that would take many times its length in memory."""
    return parse_json(Path("the answer"), text, "a chat completion", "check --endpoint", strict=False)


def _read(content: bytes, request: Request) -> Answer:
    """The answer in the body of a response. Raises _Later if the body is not a chat completion or is empty."""
    words = content.decode(errors="replace")
    try:
        found = _parse_json(words)
        choice = found["choices"][0]
        message = choice["message"]
        text, refusal = message.get("content"), message.get("refusal")
    except (InputError, LookupError, TypeError, AttributeError) as error:
        raise _RetryLater(f"the response is not a chat completion: {value_text(words)!r}") from error
    finish = choice.get("finish_reason")
    if isinstance(text, list):  # some servers answer in parts
        text = "".join(str(part.get("text", "")) for part in text if isinstance(part, dict))
    if finish == "content_filter" and not refusal:
        refusal = "a content filter"
    text = text if isinstance(text, str) else ""
    refusal = refusal if isinstance(refusal, str) else ""
    if not text and not refusal and finish != "length":
        raise _RetryLater("the answer is empty")
    into, out = _usage(found.get("usage"))
    counted = into is not None and out is not None
    return Answer(
        text,
        refusal,
        finish == "length",
        tokens_in(request) if into is None else into,
        len(text) // 4 if out is None else out,
        counted,
    )


def _usage(found: Any) -> tuple[int | None, int | None]:
    if not isinstance(found, dict):
        return None, None
    counts = (found.get("prompt_tokens"), found.get("completion_tokens"))
    into, out = (n if type(n) is int and 0 <= n < MOST_TOKENS else None for n in counts)
    return into, out


def _asked_for(headers: Mapping[str, str]) -> float | None:
    """Seconds that Retry-After asks for, as a number or as a date. None if the header is missing or invalid."""
    given = headers.get("retry-after")
    if given is None:
        return None
    try:
        seconds = float(given)
    except ValueError:
        try:
            seconds = parsedate_to_datetime(given).timestamp() - time.time()
        except (TypeError, ValueError, OverflowError):
            return None
    return max(seconds, 0.0) if seconds == seconds else None
