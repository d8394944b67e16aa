"""Apply edits by name, with JSON values as arguments: for scripts, the command line, the history, and fixes.

A script is a file of JSON lines, each {"edit": NAME, ...arguments}; `nvsim graph replay` runs it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from nvsim.files.opening import parse_integer
from nvsim.graph.arguments import check_arguments
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
    "perform_operation",
    "record",
    "usage",
]


def apply(
    graph: NavGraph, name: str, arguments: Mapping[str, Any], surroundings: EditContext | None = None
) -> NavGraph:
    """Return the graph after an operation. Raises EditError if the operation is unknown, an argument is missing,
    unknown or invalid, or the graph does not allow the edit."""
    operation = _operation(name)
    return operation.function(
        graph, surroundings or EditContext(), **check_arguments(name, operation.arguments, arguments)
    )


def describe(name: str, arguments: Mapping[str, Any]) -> str:
    """Return the text of an operation for the history, such as "Remove 3 edges". Raises EditError like `apply`."""
    operation = _operation(name)
    return operation.words(check_arguments(name, operation.arguments, arguments))


def perform_operation(
    history: History,
    name: str,
    arguments: Mapping[str, Any],
    *,
    surroundings: EditContext | None = None,
    selection: GraphSelection | None = None,
    merge: str | None = None,
) -> None:
    """Apply an operation as one step of a history, with its text and its record. New viewpoints are selected unless
    `selection` is given. Raises EditError and leaves the history unchanged if the operation fails."""
    before = history.graph
    after = apply(before, name, arguments, surroundings)
    if selection is None and len(after.viewpoints) > len(before.viewpoints):
        new = [id for id in after.viewpoints if id not in before.viewpoints]
        selection = GraphSelection(frozenset(new))
    history.perform(describe(name, arguments), after, selection, merge, record(name, arguments))


def record(name: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the script line of an operation, as JSON values."""
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
    """Return the name and the arguments of a script line. Raises EditError if the line is invalid."""
    try:
        values = json.loads(line, parse_int=parse_integer)
    except (ValueError, RecursionError) as error:
        raise EditError(f"The line is not JSON: {error}.") from error
    if not isinstance(values, dict) or not isinstance(values.get("edit"), str):
        raise EditError('The line is not an object with an "edit", the name of an operation.')
    name = values.pop("edit")
    return name, values


def line_of(edit: Mapping[str, Any]) -> str:
    """Return the script line of {"edit": name, ...arguments}. Raises EditError if the operation is unknown or an
    argument is invalid."""
    name = edit.get("edit")
    if not isinstance(name, str):
        raise EditError('It has no "edit", the name of an operation.')
    arguments = {key: value for key, value in edit.items() if key != "edit"}
    for each in arguments.get("edits") or () if name == "together" else ():
        if isinstance(each, Mapping):
            line_of(each)
    check_arguments(name, _operation(name).arguments, arguments)
    try:
        return json.dumps(record(name, arguments), allow_nan=False)
    except (ValueError, TypeError, RecursionError) as error:
        raise EditError(f"The arguments of {name} cannot be written: {error}.") from error


def _operation(name: str) -> Operation:
    operation = OPERATIONS.get(name)
    if operation is None:
        shown = name if len(name) <= 60 else name[:57] + "..."
        raise EditError(f"There is no edit {shown!r}; choose one of {', '.join(OPERATIONS)}.")
    return operation


def usage(operation: Operation) -> str:
    """Return a help line, such as "remove_edges(pairs): Remove edges"."""
    names = [f"{a.name}" if a.needed else f"{a.name}={json.dumps(a.default)}" for a in operation.arguments]
    return f"{operation.name}({', '.join(names)}): {operation.what}"
