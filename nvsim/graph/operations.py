"""Edits by name, with arguments as JSON values: for scripts, the command line, the words of the history, and fixes.

A script is a file of JSON lines, each {"edit": NAME, ...arguments}; `nvsim graph replay` runs it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from nvsim.files.regular import whole
from nvsim.graph.arguments import checked
from nvsim.graph.edits import EditError
from nvsim.graph.history import History
from nvsim.graph.operation_table import OPERATIONS, EditContext, Operation
from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import NavGraph

__all__ = [
    "OPERATIONS",
    "Operation",
    "EditContext",
    "apply",
    "describe",
    "line_of",
    "parse_line",
    "perform",
    "record",
    "usage",
]


def apply(
    graph: NavGraph, name: str, arguments: Mapping[str, Any], surroundings: EditContext | None = None
) -> NavGraph:
    """The graph after an operation. Raises EditError when there is no such operation, an argument is missing, unknown
    or not what it has to be, or the graph does not allow it."""
    operation = _named(name)
    return operation.function(graph, surroundings or EditContext(), **checked(name, operation.arguments, arguments))


def describe(name: str, arguments: Mapping[str, Any]) -> str:
    """What the operation does, for a history: "Remove 3 edges". Raises EditError like `apply`."""
    operation = _named(name)
    return operation.words(checked(name, operation.arguments, arguments))


def perform(
    history: History,
    name: str,
    arguments: Mapping[str, Any],
    *,
    surroundings: EditContext | None = None,
    selection: GraphSelection | None = None,
    merge: str | None = None,
) -> None:
    """One operation as a step of a history, with its words, its record, and the new viewpoints selected where it made
    any and no `selection` is given. Raises EditError and leaves the history as it was."""
    before = history.graph
    after = apply(before, name, arguments, surroundings)
    if selection is None and len(after.viewpoints) > len(before.viewpoints):
        new = [id for id in after.viewpoints if id not in before.viewpoints]
        selection = GraphSelection(frozenset(new))
    history.perform(describe(name, arguments), after, selection, merge, record(name, arguments))


def record(name: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """The line of a script that does it, as JSON values."""
    return {"edit": name, **{key: _plain(value) for key, value in arguments.items()}}


def _plain(value: Any) -> Any:
    if isinstance(value, set | frozenset):
        return sorted(map(_plain, value))
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value


def parse_line(line: str) -> tuple[str, dict[str, Any]]:
    """The name and the arguments of one line of a script. Raises EditError when it is none."""
    try:
        values = json.loads(line, parse_int=whole)
    except (ValueError, RecursionError) as error:
        raise EditError(f"The line is not JSON: {error}.") from error
    if not isinstance(values, dict) or not isinstance(values.get("edit"), str):
        raise EditError('The line is not an object with an "edit", the name of an operation.')
    name = values.pop("edit")
    return name, values


def line_of(edit: Mapping[str, Any]) -> str:
    """The line of a script that does {"edit": name, ...arguments}: of an operation that there is, with arguments of
    their types. Raises EditError on anything else."""
    name = edit.get("edit")
    if not isinstance(name, str):
        raise EditError('It has no "edit", the name of an operation.')
    arguments = {key: value for key, value in edit.items() if key != "edit"}
    for each in arguments.get("edits") or () if name == "together" else ():
        if isinstance(each, Mapping):
            line_of(each)
    checked(name, _named(name).arguments, arguments)
    try:
        return json.dumps(record(name, arguments), allow_nan=False)
    except (ValueError, TypeError, RecursionError) as error:
        raise EditError(f"The arguments of {name} cannot be written: {error}.") from error


def _named(name: str) -> Operation:
    operation = OPERATIONS.get(name)
    if operation is None:
        shown = name if len(name) <= 60 else name[:57] + "..."
        raise EditError(f"There is no edit {shown!r}; there are {', '.join(OPERATIONS)}.")
    return operation


def usage(operation: Operation) -> str:
    """ "remove_edges(pairs): Remove edges", for help."""
    names = [f"{a.name}" if a.needed else f"{a.name}={json.dumps(a.default)}" for a in operation.arguments]
    return f"{operation.name}({', '.join(names)}): {operation.what}"
