"""Typed values from a JSON tree. Every getter raises only InputError, with the problem and the place."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.raw import read_text
from nvsim.errors import InputError

Tree = Mapping[str, Any]


def load_object(path: Path) -> dict[str, Any]:
    """The JSON object in `path`. Raises InputError with line and column if it is not a JSON object."""
    text = read_text(path)
    try:
        tree = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path} is not valid JSON (line {error.lineno}, column {error.colno}: {error.msg}); write it again."
        ) from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not usable JSON ({type(error).__name__}); write it again.") from error
    if not isinstance(tree, dict):
        raise InputError(f"{path} holds a JSON {type(tree).__name__}, not an object; write an object.")
    return tree


def number(tree: Tree, key: str, where: str) -> float | None:
    """A finite number, or None if the key is absent. Raises InputError otherwise."""
    value = tree.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: {key!r} is {_brief(value)}, not a number; correct it.")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise InputError(f"{where}: {key!r} is not a finite number; correct it.")
    return result


def text(tree: Tree, key: str, where: str) -> str | None:
    """A non-empty string, or None if the key is absent. Raises InputError otherwise."""
    value = tree.get(key)
    if value is None:
        return None
    if not isinstance(value, str) or not value:
        raise InputError(f"{where}: {key!r} is {_brief(value)}, not a string; correct it.")
    return value


def matrix(value: object, where: str) -> NDArray[np.float64]:
    """(4, 4) float64 from nested lists of 4x4 or 3x4 numbers. NaN and infinity are kept; a later check reports them.
    Raises InputError if `value` is not such a matrix."""
    rows = value if isinstance(value, list) else []
    if len(rows) not in (3, 4) or not all(isinstance(row, list) and len(row) == 4 for row in rows):
        raise InputError(f"{where}: 'transform_matrix' is not a 4x4 matrix of numbers; correct it.")
    result = np.eye(4)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            if isinstance(entry, bool) or not isinstance(entry, int | float):
                raise InputError(f"{where}: 'transform_matrix' holds {_brief(entry)}, not a number; correct it.")
            try:
                result[i, j] = float(entry)
            except OverflowError:
                result[i, j] = math.inf
    return result


def _brief(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= 40 else shown[:37] + "..."
