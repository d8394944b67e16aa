"""Requests and answers as values: messages of text and images, and the folder that stores answers. Each answer is in a
file named by the hash of its request."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import is_regular, read_json
from nvsim.files.records import record_of

Detail = Literal["low", "high", "auto"]
Role = Literal["system", "user", "assistant"]
_FORMAT = 1
_LARGEST = 1 << 26  # bytes of a stored answer
MOST_TOKENS = 1 << 31
"""An answer with this many tokens or more is treated as invalid."""


@dataclass(frozen=True)
class Image:
    """An encoded image.

    name   identifies the image in the transcript
    data   content of a JPEG or PNG file
    width, height   pixels
    """

    name: str
    data: bytes
    width: int
    height: int

    @cached_property
    def sha256(self) -> str:
        return hashlib.sha256(self.data).hexdigest()

    @property
    def kind(self) -> str:
        return "image/png" if self.data.startswith(b"\x89PNG") else "image/jpeg"


Part = str | Image


@dataclass(frozen=True)
class Message:
    role: Role
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Request:
    """A conversation that asks for one answer.

    messages   in order
    tokens     largest number of tokens of the answer
    detail     image detail that the endpoint is asked to use
    """

    messages: tuple[Message, ...]
    tokens: int = 1000
    detail: Detail = "auto"

    def and_then(self, answer: str, question: str) -> Request:
        """The conversation extended by an answer and the next question."""
        more = Message("assistant", (answer,)), Message("user", (question,))
        return replace(self, messages=(*self.messages, *more))

    @property
    def images(self) -> tuple[Image, ...]:
        return tuple(part for message in self.messages for part in message.parts if isinstance(part, Image))

    def key(self, url: str, model: str) -> str:
        """64 hex digits: a hash of everything that the answer depends on (endpoint, model, text, and images)."""
        asked = {"url": url, "model": model, "tokens": self.tokens, "detail": self.detail}
        words = [[m.role, [p if isinstance(p, str) else {"sha256": p.sha256} for p in m.parts]] for m in self.messages]
        return hashlib.sha256(json.dumps([asked, words], sort_keys=True).encode()).hexdigest()

    def transcript(self) -> list[dict[str, Any]]:
        """The messages for human readers: images appear as names and hashes."""
        return [{"role": m.role, "parts": [_describe_part(part) for part in m.parts]} for m in self.messages]

    def body(self) -> list[dict[str, Any]]:
        """The messages in the format of chat completions. Messages without images are plain strings, which every server
        accepts."""
        return [
            {"role": m.role, "content": m.parts[0] if _plain(m) else [self._part(part) for part in m.parts]}
            for m in self.messages
        ]

    def _part(self, part: Part) -> Mapping[str, Any]:
        if isinstance(part, str):
            return {"type": "text", "text": part}
        url = f"data:{part.kind};base64,{base64.b64encode(part.data).decode()}"
        return {"type": "image_url", "image_url": {"url": url, "detail": self.detail}}


def _plain(message: Message) -> bool:
    return len(message.parts) == 1 and isinstance(message.parts[0], str)


def _describe_part(part: Part) -> str | dict[str, str]:
    return part if isinstance(part, str) else {"image": part.name, "sha256": part.sha256}


@dataclass(frozen=True)
class Answer:
    """One answer of a model.

    text        text of the answer, "" if there is none
    refusal     reason for a refusal, "" if the model did not refuse
    cut_off     whether the answer reached its token limit
    tokens_in, tokens_out   token counts of the request and of the answer
    counted     whether the endpoint reported both counts; if not, they are estimates
    """

    text: str
    refusal: str = ""
    cut_off: bool = False
    tokens_in: int = 0
    tokens_out: int = 0
    counted: bool = True


class StoredAnswers:
    """The answers in one folder. A damaged file counts as missing and is written again."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.json"

    def get(self, key: str) -> Answer | None:
        return _answer(_record(self.path(key)).get("answer"))

    def tokens_spent(self, url: str, model: str) -> tuple[int, int]:
        """Input and output tokens of all stored answers of a model."""
        into = out = 0
        for path in self.folder.glob("??/*.json"):
            found = _record(path)
            answer = _answer(found.get("answer"))
            if answer is not None and (found.get("endpoint"), found.get("model")) == (url, model):
                into, out = into + answer.tokens_in, out + answer.tokens_out
        return into, out

    def store(self, key: str, url: str, model: str, request: Request, answer: Answer) -> None:
        """Writes request and answer atomically. Raises InputError if the disk refuses."""
        kept = {
            "format": _FORMAT,
            "endpoint": url,
            "model": model,
            "messages": request.transcript(),
            "answer": asdict(answer),
        }
        # A model's text may contain halves of surrogate pairs, which UTF-8 cannot encode. JSON escapes can.
        atomic.write_text(self.path(key), json.dumps(kept, indent=1) + "\n")


def _record(path: Path) -> dict[str, Any]:
    """The content of a file, {} if it is missing or damaged."""
    if not is_regular(path):
        return {}
    try:
        found = read_json(path, "a stored answer", "remove it", _LARGEST)
    except InputError:
        return {}
    return found if isinstance(found, dict) and found.get("format") == _FORMAT else {}


def _answer(found: Any) -> Answer | None:
    try:
        answer = record_of(Answer, found)
    except ValueError:
        return None
    return answer if all(0 <= n < MOST_TOKENS for n in (answer.tokens_in, answer.tokens_out)) else None
