"""Arguments of named edits: JSON values are converted to typed values or refused with a message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from nvsim.errors import value_text
from nvsim.files.opening import is_number
from nvsim.graph.edits import EditError
from nvsim.graph.types import Edge, Viewpoint

NEEDED: Any = object()


@dataclass(frozen=True)
class Argument:
    """One argument of a named edit.

    name     name in scripts
    kind     a key of KINDS
    what     description for help and messages
    default  value of an omitted argument; NEEDED marks a required argument
    """

    name: str
    kind: str
    what: str
    default: Any = NEEDED

    @property
    def needed(self) -> bool:
        return self.default is NEEDED


def check_arguments(edit: str, arguments: tuple[Argument, ...], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the typed values of all arguments. Raises EditError if an argument is missing, unknown, or of the wrong
    kind."""
    known = {argument.name for argument in arguments}
    for name in values:
        if name not in known:
            raise EditError(f"{edit} has no argument {value_text(repr(name))}; it takes {', '.join(sorted(known))}.")
    found = {}
    for argument in arguments:
        value = values.get(argument.name)
        if value is None:
            if argument.needed:
                raise EditError(f"{edit} needs {argument.name}: {argument.what}.")
            found[argument.name] = argument.default
            continue
        words, parse = KINDS[argument.kind]
        try:
            found[argument.name] = parse(value)
        except (TypeError, ValueError, KeyError, OverflowError) as error:
            raise EditError(f"{argument.name} of {edit} is {value_text(value)}; it must be {words}.") from error
    return found


def _name(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


def _flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError
    return value


def _number(value: object) -> float:
    if not is_number(value):
        raise TypeError
    return float(value)  # type: ignore[arg-type]


def _integer(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError
    return value


def _share(value: object) -> float:
    share = _number(value)
    if not 0 <= share <= 1:
        raise TypeError
    return share


def _place(value: object) -> tuple[float, float, float]:
    x, y, z = map(_number, _list(value))
    return x, y, z


def _places(value: object) -> dict[str, tuple[float, float, float]]:
    if not isinstance(value, Mapping):
        raise TypeError
    return {_name(id): _place(place) for id, place in value.items()}


def _edge(value: object) -> tuple[str, str]:
    a, b = map(_name, _list(value))
    return a, b


def _viewpoint(value: object) -> Viewpoint:
    if not isinstance(value, Mapping):
        raise TypeError
    known = dict(value)
    place = _place(known.pop("position"))
    return Viewpoint(position=place, **{name: _FIELDS[name](known[name]) for name in known})


def _edge_value(value: object) -> Edge:
    if not isinstance(value, Mapping) or {"a", "b"} - set(value):
        raise TypeError
    return Edge(**{name: _FIELDS[name](value[name]) for name in value})


def _edit(value: object) -> dict[str, Any]:
    if not isinstance(value, Mapping) or not isinstance(value.get("edit"), str):
        raise TypeError
    return dict(value)


def _list(value: object) -> list[Any]:
    if isinstance(value, set | frozenset):
        return sorted(value)  # sorted, so that an edit gives an identical graph in every run
    if not isinstance(value, list | tuple):
        raise TypeError
    return list(value)


_FIELDS: Mapping[str, Callable[[object], Any]] = {
    **dict.fromkeys(("id", "a", "b", "origin"), _name),
    **dict.fromkeys(("included", "reviewed", "locked"), _flag),
    "height": _number,
    "photographed": lambda value: None if value is None else _share(value),
    "submap": _integer,
}
"""Parsers for the fields of viewpoints and edges, except the position."""

KINDS: dict[str, tuple[str, Callable[[object], Any]]] = {
    "name": ("a string", _name),
    "flag": ("true or false", _flag),
    "number": ("a finite number", _number),
    "integer": ("an integer", _integer),
    "place": ("a list of three finite numbers", _place),
    "places": ("an object of lists of three finite numbers", _places),
    "edge": ("a list of two ids", _edge),
    "viewpoints": ("a list of ids", lambda value: tuple(map(_name, _list(value)))),
    "edges": ("a list of pairs of ids", lambda value: tuple(map(_edge, _list(value)))),
    "whole viewpoints": (
        'a list of objects such as {"id": "a", "position": [1, 2, 1.5], "height": 1.5}',
        lambda value: tuple(map(_viewpoint, _list(value))),
    ),
    "whole edges": (
        'a list of objects such as {"a": "x", "b": "y", "origin": "person"}',
        lambda value: tuple(map(_edge_value, _list(value))),
    ),
    "edits": (
        'a list of objects such as {"edit": "remove_edges", "pairs": [["a", "b"]]}',
        lambda value: tuple(map(_edit, _list(value))),
    ),
}
"""Kind -> (description of valid values, parser). Parsers raise TypeError, ValueError or KeyError."""
