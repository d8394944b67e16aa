"""Write a history as a script: lines that repeat its edits.

A history may come with a project from other people. Each line is therefore made from a named edit with checked
arguments, never from stored text. A script only replaces other scripts, no files of another kind.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files.atomic import write_text
from nvsim.files.opening import read_regular
from nvsim.files.placeholders import placeholder_reason
from nvsim.files.reading import as_reading_error
from nvsim.graph.difference import GraphDelta, delta_between
from nvsim.graph.edits import EditError
from nvsim.graph.history import History
from nvsim.graph.operations import line_of, parse_line

HEAD = "# Edits of a navigation graph, for `nvsim graph replay`"
_MOST_WORDS = 200  # maximum characters of a comment
_MOST_BYTES = 64 << 20


def script(history: History) -> list[str]:
    """Return the JSON lines that lead from the first to the current step.

    A step without a named edit becomes a patch of its viewpoints and edges. It becomes a comment if a patch cannot
    express it (evidence, order), or if a job or another program changed the graph. Raises InputError if a step names an
    unknown edit or has invalid arguments.
    """
    lines = []
    for index, step in enumerate(history.steps[1 : history.index + 1], 1):
        found = step.operation
        if found is None and step.edit:
            found = _patch(delta_between(history.graph_at(index - 1), history.graph_at(index)), step.text)
            if found is None:
                lines.append(comment(step.text))
        if found is None and step.outside:
            lines.append(comment(step.text))
        if found is not None:
            try:
                lines.append(line_of(found))
            except EditError as error:
                raise InputError(f"Step {index} of the history cannot be written as a script: {error}") from error
    return lines


def comment(text: str) -> str:
    """Return a comment of one line that contains nothing executable."""
    plain = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return f"# {plain if len(plain) <= _MOST_WORDS else plain[: _MOST_WORDS - 3] + '...'}"


def write_script(path: Path, lines: Iterable[str]) -> None:
    """Write a script; an existing script is replaced. Raises InputError if `path` is a file of another kind, which
    stays unchanged, or if it cannot be written."""
    if path.is_symlink() or path.exists():
        try:
            begin = read_regular(path, _MOST_BYTES).decode("utf-8").splitlines()
        except (OSError, UnicodeDecodeError):
            begin = ["no script"]
        if not _is_script(begin):
            raise InputError(f"{path} already exists and is not a script of edits; choose another name, or remove it.")
    write_text(path, "".join(f"{line}\n" for line in (HEAD, *lines)))


def script_lines(path: Path) -> list[str]:
    """Return the lines of a script. Raises InputError if it is not text or is too long."""
    try:
        data = read_regular(path, _MOST_BYTES)
        if words := placeholder_reason(data, len(data)):
            raise InputError(f"{path} {words}.")
        return data.decode("utf-8").splitlines()
    except OSError as error:
        raise as_reading_error(path, error) from error
    except UnicodeDecodeError as error:
        raise InputError(f"Cannot read {path}: it is not text; give a file of JSON lines.") from error


def _is_script(lines: list[str]) -> bool:
    """Whether a file begins with HEAD, or with an edit as scripts of older versions do. An empty file counts as a
    script."""
    first = next((line for line in lines if line.strip() and not line.startswith("# ")), None)
    if first is None:
        return not lines or lines[0] == HEAD
    try:
        parse_line(first)
    except EditError:
        return False
    return True


def _patch(delta: GraphDelta, text: str) -> dict[str, Any] | None:
    if any(delta.orders) or not (delta.viewpoints or delta.edges or delta.no_viewpoints or delta.no_edges):
        return None
    values: dict[str, Any] = {
        "viewpoints": [dataclasses.asdict(v) for v in delta.viewpoints],
        "edges": [dataclasses.asdict(e) for e in delta.edges],
        "no_viewpoints": list(delta.no_viewpoints),
        "no_edges": [list(key) for key in delta.no_edges if not set(key) & set(delta.no_viewpoints)],
    }
    return {"edit": "patch", **{name: value for name, value in values.items() if value}, "text": text}
