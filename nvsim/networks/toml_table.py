"""Typed values from a TOML file. If a value has another type, the error names the key."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from nvsim.errors import InputError, value_text
from nvsim.files.reading import reading

LARGEST = 1 << 16
"""Largest size of a description in bytes."""
_MOST_NUMBERS = 4096
T = TypeVar("T")


def parse_toml(text: str, path: Path) -> dict[str, Any]:
    """The TOML `text` of the file `path`, parsed. Raises InputError if it is not valid TOML."""
    with reading(path, "a TOML file", "correct the line that it names"):
        return tomllib.loads(text)


class TomlTable:
    """Reads values from a table of the file `path`, and records which keys were read.

    `where` names the table within the file, "" for the whole file. A missing value becomes the `default`; without a
    default, the key is required. Every method raises InputError with the file, the key, and the accepted values.
    """

    def __init__(self, values: dict[str, Any], path: Path, where: str = "") -> None:
        self._values, self._known = values, set[str]()
        self.path, self._where = path, where

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def keys(self) -> list[str]:
        return list(self._values)

    def _checked_value(self, key: str, default: T | None, right: str, fits: Callable[[Any], bool]) -> Any:
        self._known.add(key)
        value = self._values.get(key)
        if value is None and default is not None:
            return default
        if value is None or not fits(value):
            raise self.error(key, right)
        return value

    def error(self, key: str, right: str) -> InputError:
        """The error for the value at `key`, which must be `right`."""
        value = self._values.get(key)
        said = "is missing" if value is None else f"is {value_text(value)}"
        return InputError(f"{self.path}: {self._where}{key} {said}; it must be {right}.")

    def integer(self, key: str, most: int, default: int | None = None, least: int = 1) -> int:
        right = f"a whole number from {least} to {most}"
        return int(self._checked_value(key, default, right, lambda v: type(v) is int and least <= v <= most))

    def size(self, most: int, default: tuple[int, int] | None = None) -> tuple[int, int]:
        """The key `size`: one number, or height and width. The `default` (0, 0) means a dynamic size."""
        right = f"[height, width] in pixels, at most {most} each"

        def fits(value: Any) -> bool:
            sides = value if isinstance(value, list) else [value, value]
            return len(sides) == 2 and all(type(n) is int and 0 < n <= most for n in sides)

        value = self._checked_value("size", default, right, fits)
        return (value, value) if isinstance(value, int) else (value[0], value[1])

    def number(self, key: str, default: float | None = None, positive: bool = True) -> float:
        right = "a number above 0" if positive else "a number"
        return float(self._checked_value(key, default, right, lambda v: _is_number(v) and (v > 0 or not positive)))

    def three(
        self, key: str, default: tuple[float, float, float] | None = None, positive: bool = False
    ) -> tuple[float, float, float]:
        right = f"three numbers{' above 0' if positive else ''}, one for each color"

        def fits(value: Any) -> bool:
            numbers = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
            return numbers and (not positive or min(value) > 0)

        value = self._checked_value(key, default, right, fits)
        return float(value[0]), float(value[1]), float(value[2])

    def numbers(self, key: str, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """A number, or a list of numbers."""

        def fits(value: Any) -> bool:
            listed = value if isinstance(value, list) else [value]
            return len(listed) <= _MOST_NUMBERS and all(map(_is_number, listed))

        value = self._checked_value(key, default, "a number or a list of numbers", fits)
        return tuple(float(v) for v in (value if isinstance(value, (list, tuple)) else [value]))

    def integers(self, key: str, most: int, default: tuple[int, ...] | None = None) -> tuple[int, ...]:
        """A list of whole numbers from 0 to `most`."""
        right = f"a list of whole numbers from 0 to {most}"

        def fits(value: Any) -> bool:
            return (
                isinstance(value, list) and len(value) < 100 and all(type(n) is int and 0 <= n <= most for n in value)
            )

        return tuple(self._checked_value(key, default, right, fits))

    def one_of(self, key: str, allowed: tuple[Any, ...], default: Any = None) -> Any:
        right = f"one of {', '.join(allowed)}"
        return self._checked_value(key, default, right, lambda v: isinstance(v, str) and v in allowed)

    def flag(self, key: str, default: bool) -> bool:
        return bool(self._checked_value(key, default, "true or false", lambda v: type(v) is bool))

    def word(self, key: str, default: str | None = None) -> str:
        return str(self._checked_value(key, default, "a text of 1 to 200 characters", _is_word))

    def words(self, key: str, default: tuple[str, ...] | None = None) -> tuple[str, ...]:
        """A text, or a list of texts."""

        def fits(value: Any) -> bool:
            listed = value if isinstance(value, list) else [value]
            return 0 < len(listed) <= 100 and all(map(_is_word, listed))

        value = self._checked_value(key, default, "a text of 1 to 200 characters, or a list of them", fits)
        return (value,) if isinstance(value, str) else tuple(value)

    def table(self, key: str) -> TomlTable:
        """The table at `key`, empty if it is missing."""
        value = self._checked_value(key, {}, "a table", lambda v: isinstance(v, dict))
        return TomlTable(value, self.path, f"{self._where}{key}.")

    def tables(self, key: str) -> list[TomlTable]:
        """The list of tables at `key`, empty if it is missing."""

        def fits(value: Any) -> bool:
            return isinstance(value, list) and len(value) <= 100 and all(isinstance(v, dict) for v in value)

        value = self._checked_value(key, [], "a list of tables", fits)
        return [TomlTable(v, self.path, f"{self._where}{key}[{n}].") for n, v in enumerate(value, 1)]

    def refuse_others(self) -> None:
        """Raises InputError if the table has a key that was never read."""
        for key in self._values:
            if key not in self._known:
                known = ", ".join(sorted(self._known))
                raise InputError(f"{self.path}: {self._where}{value_text(key)} is unknown; the known keys are {known}.")


def _is_word(value: Any) -> bool:
    return isinstance(value, str) and 0 < len(value) <= 200 and value.isprintable()


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) < 1e9 and math.isfinite(value)
