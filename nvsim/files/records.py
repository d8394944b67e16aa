"""Converts parsed JSON to typed values, as the type hints of dataclasses say."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from nvsim.errors import value_text

T = TypeVar("T")
_LARGEST = 1e15  # absolute value of a float; an integer has at most 63 bits
Count = Annotated[int, 0]
"""A whole number that is not negative."""
Figure = Annotated[float, 0]
"""A number that is not negative."""
_WORDS = {int: "a whole number", float: "a number in range", str: "text", bool: "true or false", type(None): "null"}


def record_of(kind: type[T], data: object) -> T:
    """The dataclass `kind` of a JSON object: strings, numbers, booleans, null, literals, tuples, and other dataclasses.
    Missing values have their defaults, and unknown names are ignored.

    Raises ValueError if `data` is not an object, or if a value is missing, has another type, or is not finite."""
    if not isinstance(data, Mapping):
        raise ValueError(f"{value_text(data, 40)} is not an object")
    given = {}
    for name, (hint, required) in _fields(kind).items():  # type: ignore[arg-type]
        if name in data:
            given[name] = _value(hint, data[name])
        elif required:
            raise ValueError(f"{name} is missing")
    return kind(**given)


@cache
def _fields(kind: Any) -> dict[str, tuple[Any, bool]]:
    """Name -> the type of a field, and whether it is required."""
    hints = get_type_hints(kind, include_extras=True)
    return {f.name: (hints[f.name], f.default is MISSING and f.default_factory is MISSING) for f in fields(kind)}


# Any: a value of a file, which is converted or refused.
def _value(kind: Any, data: Any) -> Any:
    origin, inner = get_origin(kind), get_args(kind)
    if is_dataclass(kind):
        return record_of(kind, data)  # type: ignore[arg-type]
    if origin in (Union, types.UnionType):
        for one in inner[:-1]:
            try:
                return _value(one, data)
            except ValueError:
                continue
        return _value(inner[-1], data)
    if origin is Annotated and (value := _value(inner[0], data)) >= inner[1]:
        return value
    if origin is tuple and isinstance(data, list):
        each = [inner[0]] * len(data) if inner[-1] is Ellipsis else inner
        if len(each) == len(data):
            return tuple(_value(one, value) for one, value in zip(each, data, strict=True))
    if kind is float:
        if type(data) in (int, float) and abs(data) < _LARGEST:
            return float(data)
    elif type(data) is kind and (kind is not int or abs(data) < 1 << 63):
        return data
    if origin is Literal and data in inner:
        return data
    raise ValueError(f"{value_text(data, 40)} is not {_WORDS.get(kind, 'valid')}")
