"""Commands that select, edit and record parts of a navigation graph."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.terminal import as_json, print_lines
from nvsim.errors import InputError
from nvsim.files.opening import parse_integer
from nvsim.occupancy.types import Heights

if TYPE_CHECKING:
    from nvsim.cli.graph_target import GraphTarget
    from nvsim.graph.difference import Difference
    from nvsim.graph.history import History
    from nvsim.graph.operations import Operation
    from nvsim.graph.types import NavGraph


@dataclass(frozen=True)
class GraphSelect:
    """List the viewpoints and edges of a graph that match an expression, such as `degree > 4 and not reviewed`.

    Quantities of viewpoints: id, x, y, z, height, submap, included, reviewed, locked, origin, degree, component,
    storey, evidence, validity. Of edges: x, y, z, submap, component, storey, reviewed, locked, origin, length, slope,
    alpha, evidence, validity.
    """

    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    where: Positional[str]
    """The expression."""
    kind: Literal["viewpoints", "edges"] | None = None
    """List only viewpoints or only edges. Default: both, if they have the quantities of the expression."""
    occupancy: Path | None = None
    """For `validity`: a ROS map.yaml or an OctoMap .bt or .ot, instead of the one found next to the graph."""
    heights: Inline[Heights] = field(default_factory=Heights)
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        from nvsim.cli.graph_target import GraphTarget, edit_errors_as_input_errors
        from nvsim.graph.expression import by_expression

        target = GraphTarget(self.graph, self.occupancy, self.heights)
        graph = target.read()
        with edit_errors_as_input_errors():
            chosen = by_expression(graph, self.where, target.known(self.where), self.kind)
        viewpoints = [id for id in graph.viewpoints if id in chosen.viewpoints]
        edges = [key for key in graph.edges if key in chosen.edges]
        if self.json:
            print_lines(as_json({"viewpoints": viewpoints, "edges": edges}))
        else:
            print_lines(*viewpoints, *(f"{a} {b}" for a, b in edges))
        return 0


@dataclass(frozen=True)
class EditOptions:
    """Options of the commands that edit a graph."""

    occupancy: Path | None = None
    """A ROS map.yaml or an OctoMap .bt or .ot, instead of the one found next to the graph."""
    heights: Inline[Heights] = field(default_factory=Heights)
    dry_run: bool = False
    """Report the changes without making them."""
    out: Path | None = None
    """Write the result to this connectivity file and do not change the graph."""
    json: bool = False
    """Print one JSON object."""


@dataclass(frozen=True)
class GraphEdit:
    """Edit the graph of a project or a connectivity file: `nvsim graph edit FILE remove_edges --where "length > 5"`.

    `nvsim graph edit FILE list` prints the edits with their arguments. The viewpoints and edges that --where selects
    become the arguments of the edit. The edit is saved completely or not at all. In a project, a window can undo it.
    """

    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    edit: Positional[str]
    """The name of the edit, or `list`."""
    where: str | None = None
    """An expression, as in `nvsim graph select`."""
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")] = ()
    """Arguments of the edit, with values as JSON: distance=3 even=true position=[1,2,1.5] ids='["a"]'."""
    how: Inline[EditOptions] = field(default_factory=EditOptions)

    def run(self) -> int:
        """Runs the command. Raises InputError if the edit is unknown, or if its arguments are invalid."""
        from nvsim.cli.graph_target import GraphTarget, edit_errors_as_input_errors
        from nvsim.graph.operations import OPERATIONS, describe, perform_operation, usage

        target = GraphTarget(self.graph, self.how.occupancy, self.how.heights)
        if self.edit == "list":
            print_lines(*(usage(operation) for operation in OPERATIONS.values()))
            return 0
        operation = OPERATIONS.get(self.edit)
        if operation is None:
            raise InputError(f"There is no edit {self.edit!r}; `nvsim graph edit FILE list` prints them.")
        given = _parse_arguments(self.set)

        def change(history: History) -> str:
            with edit_errors_as_input_errors():
                values = _values(self, target, history.graph, operation, given)
                if values is None:
                    return ""
                perform_operation(history, operation.name, values, surroundings=target.surroundings())
                return describe(operation.name, values)

        return _edit(self.how, target, change)


def _edit(how: EditOptions, target: GraphTarget, change: Callable[[History], str]) -> int:
    """Changes the graph, or a copy of it for --dry-run and --out, and prints the changes. `change` returns the text of
    the edit, "" if it changes nothing."""
    from nvsim.graph.history import History

    if how.dry_run or how.out is not None:
        history = History(target.read())
        before, words = history.graph, change(history)
        written = None if how.dry_run else target.write(history.graph, how.out)
    else:
        with target.editing() as history:
            before, words = history.graph, change(history)
        written = None if history.graph is before else target.path
    original = target.original if written == target.path else None
    _report(before, history.graph, words, written, how.json, original)
    return 0


def _report(
    before: NavGraph, after: NavGraph, words: str, written: Path | None, in_json: bool, original: Path | None
) -> None:
    """Prints the changes of the graph, and the path `original` of the unedited file if one was kept."""
    from nvsim.graph.difference import difference
    from nvsim.graph.foreign import disconnected_warning
    from nvsim.graph.paths import components

    change = difference(before, after)
    if in_json:
        counts = {name: len(getattr(change, name)) for name in change.__dataclass_fields__}
        where = None if written is None else str(written)
        kept = None if original is None else str(original)
        parts = len(components(after))
        print_lines(as_json({"text": words, "changed": counts, "written": where, "original": kept, "islands": parts}))
        return
    print_lines(f"{words}: {_sentence(change)}." if words else "Nothing matches; nothing was changed.")
    if written is not None:
        print_lines(f"Wrote {written}")
        if original is not None:
            print_lines(f"The original file is kept as {original}")
        if sentence := disconnected_warning(after):
            print_lines(sentence)


def _sentence(change: Difference) -> str:
    from nvsim.plain_text import count_text

    parts = [
        f"{count_text(len(names), thing)} {word}"
        for thing, kinds in (
            ("viewpoint", (change.added_viewpoints, change.removed_viewpoints, change.changed_viewpoints)),
            ("edge", (change.added_edges, change.removed_edges, change.changed_edges)),
        )
        for names, word in zip(kinds, ("added", "removed", "changed"), strict=True)
        if names
    ]
    return ", ".join(parts) or "nothing changed"


def _values(
    arguments: GraphEdit, target: GraphTarget, graph: NavGraph, operation: Operation, given: Mapping[str, Any]
) -> dict[str, Any] | None:
    """All arguments of the edit. None if --where selects nothing for it. Raises InputError if the edit takes no
    viewpoints or edges."""
    from nvsim.graph.expression import by_expression

    if arguments.where is None:
        return dict(given)
    takes = {a.kind: a.name for a in operation.arguments if a.kind in ("viewpoints", "edges") and a.name not in given}
    if not takes:
        raise InputError(f"{operation.name} takes no viewpoints or edges that --where could select.")
    kind = next(iter(takes)) if len(takes) == 1 else None
    chosen = by_expression(graph, arguments.where, target.known(arguments.where), kind)  # type: ignore[arg-type]
    if not chosen:
        return None
    found: dict[str, Any] = {}
    if "viewpoints" in takes:
        found[takes["viewpoints"]] = [id for id in graph.viewpoints if id in chosen.viewpoints]
    if "edges" in takes:
        found[takes["edges"]] = [list(key) for key in graph.edges if key in chosen.edges]
    return {**given, **found}


def _parse_arguments(words: tuple[str, ...]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals:
            raise InputError(f"{word!r} is not an argument; write NAME=VALUE.")
        try:
            found[name] = json.loads(text, parse_int=parse_integer)
        except ValueError:
            found[name] = text
    return found


@dataclass(frozen=True)
class GraphReplay:
    """Apply the edits of a script again, to a project or a connectivity file. A script has one JSON object per line,
    such as {"edit": "remove_edges", "pairs": [["a", "b"]]}; `nvsim graph log --script` writes one. Empty lines and
    lines that begin with # are skipped. Either all edits are saved, or none."""

    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    script: Positional[Path]
    """The script, as JSON lines."""
    how: Inline[EditOptions] = field(default_factory=EditOptions)

    def run(self) -> int:
        from nvsim.cli.graph_target import GraphTarget, edit_errors_as_input_errors
        from nvsim.graph.operations import parse_line, perform_operation
        from nvsim.graph.scripts import script_lines
        from nvsim.plain_text import count_text

        target = GraphTarget(self.graph, self.how.occupancy, self.how.heights)
        lines = script_lines(self.script)
        surroundings = target.surroundings()

        def apply_script(history: History) -> str:
            count = 0
            for number, line in enumerate(lines, 1):
                if line.strip() and not line.lstrip().startswith("#"):
                    with edit_errors_as_input_errors(f"{self.script}, line {number}: "):
                        perform_operation(history, *parse_line(line), surroundings=surroundings)
                    count += 1
            return f"Replay {count_text(count, 'edit')}"

        return _edit(self.how, target, apply_script)


@dataclass(frozen=True)
class GraphLog:
    """List the edits of a project, or of a connectivity file that is open in a window or has unsaved edits. With
    --script, write them as a script for `nvsim graph replay`."""

    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    script: Path | None = None
    """Write the edits up to the current step as JSON lines into this file. An existing file is replaced only if it is a
    script."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        from nvsim.cli.graph_target import GraphTarget
        from nvsim.graph.scripts import script, write_script

        target = GraphTarget(self.graph)
        with target.journal() as journal:
            history = journal.history(target.read())
            steps, index, clean = history.steps, history.index, history.saved_index
            if self.script is not None:
                write_script(self.script, script(history))
        if self.json:
            rows = [{"text": s.text, "when": s.when, "edit": s.edit, "operation": s.operation} for s in steps]
            print_lines(as_json({"steps": rows, "index": index, "saved": clean}))
            return 0
        for number, step in enumerate(steps):
            if step.changes or number == 0:
                when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(step.when))
                marks = " (saved)" if number == clean else ""
                print_lines(f"{'>' if number == index else ' '} {number:4d}  {when}  {step.text}{marks}")
        if journal.notice:
            print_lines(journal.notice)
        return 0
