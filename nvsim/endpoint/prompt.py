"""Prompts in editable files: sections under [name] lines, with $placeholders.

A line that begins with # before the first section is a comment. `$$` is a dollar sign.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import nvsim_resources
from nvsim.endpoint.request import Part
from nvsim.errors import InputError
from nvsim.files.opening import read_text

FOLDER = Path(nvsim_resources.__file__).parent / "prompts"
_SECTION = re.compile(r"\[([a-z ]+)\]\s*")
_PLACE = re.compile(r"\$(?:(\$)|([a-z_]+)|\{([a-z_]+)\}|())")
_LARGEST = 1 << 20  # bytes
Values = Mapping[str, str | Sequence[Part]]


@dataclass(frozen=True)
class Prompt:
    """A prompt file: its path, and its sections as name -> text."""

    path: Path
    sections: Mapping[str, str]

    @staticmethod
    def read(path: Path, needs: Mapping[str, tuple[Sequence[str], Sequence[str]]]) -> Prompt:
        """Reads a prompt. needs: section -> its required placeholders and its optional placeholders.

        Raises InputError naming the section or placeholder that is missing, unknown, or duplicate.
        """
        text = read_text(path, "a prompt", "write it again", _LARGEST)
        sections: dict[str, list[str]] = {}
        lines: list[str] | None = None
        for number, line in enumerate(text.splitlines(), 1):
            found = _SECTION.fullmatch(line)
            if found:
                if found[1] in sections:
                    raise InputError(f"{path}, line {number}: the section [{found[1]}] appears twice; merge both.")
                lines = sections[found[1]] = []
            elif lines is not None:
                lines.append(line)
            elif line.strip() and not line.startswith("#"):
                raise InputError(f"{path}, line {number}: there is text before the first section; begin with [system].")
        for name, (must, may) in needs.items():
            if name not in sections:
                raise InputError(f"{path} has no section [{name}]; add it, as in {FOLDER / path.name}.")
            there = [p[2] or p[3] for p in _PLACE.finditer("\n".join(sections[name])) if not p[1]]
            unknown = next((place for place in there if place not in (*must, *may)), None)
            if unknown is not None:
                known = ", ".join(f"${place}" for place in (*must, *may))
                raise InputError(
                    f"{path}, [{name}]: ${unknown} is not known; write {known or 'none'}, or $$ for a dollar sign."
                )
            missing = next((place for place in must if place not in there), None)
            if missing is not None:
                raise InputError(f"{path}, [{name}]: ${missing} is missing, which the model needs; add it.")
        return Prompt(path, {name: "\n".join(rows).strip() for name, rows in sections.items()})

    @property
    def sha256(self) -> str:
        return hashlib.sha256(repr(sorted(self.sections.items())).encode()).hexdigest()

    def fill(self, section: str, values: Values) -> tuple[Part, ...]:
        """A section with its placeholders replaced. Strings become part of the text. Other parts, such as images, are
        inserted between texts. No part is empty."""
        parts: list[Part] = []
        words, at, text = "", 0, self.sections[section]
        for place in _PLACE.finditer(text):
            words, at = words + text[at : place.start()], place.end()
            value = "$" if place[1] else values[place[2] or place[3]]
            if isinstance(value, str):
                words += value
                continue
            parts += [*([words] if words.strip() else []), *value]
            words = ""
        words += text[at:]
        return tuple([*parts, words] if words.strip() or not parts else parts)

    def text(self, section: str, values: Mapping[str, str]) -> str:
        """A section that contains only text, with its placeholders replaced."""
        return "".join(part for part in self.fill(section, values) if isinstance(part, str))
