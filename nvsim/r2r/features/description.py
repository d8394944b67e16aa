"""What a TOML file says about the ONNX network beside it: CLIP.toml about CLIP.onnx."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.regular import read_text, shown
from nvsim.r2r.features.preparing import Axes, Colours, Interpolation, Preparation, Resize

LARGEST = 1 << 16
"""Bytes of a description."""
MOST_PIXELS, MOST_WIDTH = 2048, 65536
_EXAMPLE = "width = 512 and size = [224, 224]"


@dataclass(frozen=True)
class Description:
    """name         what to call the network in the files it makes
    width        numbers of an image that its output has
    preparation  what it takes
    output       the name of its output, None where it has one only
    classes      the name of a second output with 1000 logits, None where there is none
    """

    name: str
    width: int
    preparation: Preparation
    output: str | None = None
    classes: str | None = None


def read_description(model: Path) -> Description:
    """The description beside `model`. Raises InputError where it is missing, is no TOML, lacks `width` or `size`, or
    says something that is not known."""
    path = model.with_suffix(".toml")
    if not path.is_file():
        raise InputError(f"{path} is missing; say in it what {model.name} takes and gives, at least {_EXAMPLE}.")
    return parse_description(read_text(path, "a description of a network", "save it as UTF-8", LARGEST), path)


def parse_description(text: str, path: Path) -> Description:
    """The description in `text`, from the file `path`. Raises InputError with the key that is wrong."""
    with reading(path, "a TOML file", "mend the line that it names"):
        values = tomllib.loads(text)
    table = _Table(values, path)
    height, width = table.size()
    description = Description(
        name=table.word("name", path.stem),
        width=table.whole("width", MOST_WIDTH),
        preparation=Preparation(
            height,
            width,
            table.one_of("resize", get_args(Resize)),
            table.one_of("interpolation", get_args(Interpolation)),
            table.number("brightest", Preparation.brightest),
            table.three("mean", Preparation.mean),
            table.three("std", Preparation.std, positive=True),
            table.one_of("colours", get_args(Colours)),
            table.one_of("layout", get_args(Axes)),
        ),
        output=table.word("output", "") or None,
        classes=table.word("classes", "") or None,
    )
    table.refuse_others()
    return description


class _Table:
    """Takes values out of a parsed file, each of its kind, and knows which nobody asked for."""

    def __init__(self, values: dict[str, Any], path: Path) -> None:
        self._values, self._path, self._known = values, path, set[str]()

    def _take(self, key: str) -> Any:
        self._known.add(key)
        return self._values.get(key)

    def _wrong(self, key: str, value: Any, right: str) -> InputError:
        said = "is missing" if value is None else f"is {shown(value)}"
        return InputError(f"{self._path}: {key} {said}; it must be {right}.")

    def whole(self, key: str, most: int) -> int:
        value = self._take(key)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 < value <= most:
            raise self._wrong(key, value, f"a whole number from 1 to {most}")
        return value

    def size(self) -> tuple[int, int]:
        value = self._take("size")
        sides = value if isinstance(value, list) else [value, value]
        if len(sides) != 2 or not all(type(n) is int and 0 < n <= MOST_PIXELS for n in sides):
            raise self._wrong("size", value, f"[height, width] in pixels, at most {MOST_PIXELS} each")
        return sides[0], sides[1]

    def number(self, key: str, default: float) -> float:
        value = self._take(key)
        if value is None:
            return default
        if not _is_number(value) or value <= 0:
            raise self._wrong(key, value, "a number above 0")
        return float(value)

    def three(
        self, key: str, default: tuple[float, float, float], positive: bool = False
    ) -> tuple[float, float, float]:
        value = self._take(key)
        if value is None:
            return default
        right = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
        if not right or (positive and min(value) <= 0):
            raise self._wrong(key, value, f"three numbers{' above 0' if positive else ''}, one for each colour")
        return float(value[0]), float(value[1]), float(value[2])

    def one_of(self, key: str, allowed: tuple[Any, ...]) -> Any:
        value = self._take(key)
        if value is None:
            return getattr(Preparation, key)
        if not isinstance(value, str) or value not in allowed:
            raise self._wrong(key, value, f"one of {', '.join(allowed)}")
        return value

    def word(self, key: str, default: str) -> str:
        value = self._take(key)
        if value is None:
            return default
        if not isinstance(value, str) or not 0 < len(value) <= 200 or not value.isprintable():
            raise self._wrong(key, value, "a text of 1 to 200 characters")
        return value

    def refuse_others(self) -> None:
        for key in self._values:
            if key not in self._known:
                raise InputError(
                    f"{self._path}: {shown(key)} is not known; a description says {', '.join(sorted(self._known))}."
                )


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) < 1e9 and math.isfinite(value)
