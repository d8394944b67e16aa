"""A request as a value: messages of text and images, and the hash under which its answer is stored."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

Detail = Literal["low", "high", "auto"]
Role = Literal["system", "user", "assistant"]


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
        return [{"role": m.role, "parts": [_named(part) for part in m.parts]} for m in self.messages]

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


def _named(part: Part) -> str | dict[str, str]:
    return part if isinstance(part, str) else {"image": part.name, "sha256": part.sha256}
