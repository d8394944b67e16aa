"""Answers of models, and the folder that stores them. Each is in a file named by the hash of its request."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from nvsim.endpoint.request import Request
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import is_regular, read_json

_FORMAT = 1
_LARGEST = 1 << 26  # bytes of a stored answer
MOST_TOKENS = 1 << 31
"""An answer with this many tokens or more is treated as invalid."""


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
    if not isinstance(found, dict) or found.keys() != {field.name for field in fields(Answer)}:
        return None
    kinds = {"text": str, "refusal": str, "cut_off": bool, "tokens_in": int, "tokens_out": int, "counted": bool}
    if any(type(found[name]) is not kind for name, kind in kinds.items()):
        return None
    answer = Answer(**found)
    return answer if all(0 <= n < MOST_TOKENS for n in (answer.tokens_in, answer.tokens_out)) else None
