"""Apply the edits of a script again, to a project or a connectivity file. A script has one JSON object per line, such
as {"edit": "remove_edges", "pairs": [["a", "b"]]}; `nvsim graph log --script` writes one. Empty lines and lines that
begin with # are skipped. Either all edits are saved, or none."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli.arguments import Inline, Positional
from nvsim.occupancy.heights import Heights


@dataclass(frozen=True)
class Arguments:
    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    script: Positional[Path]
    """The script, as JSON lines."""
    occupancy: Path | None = None
    """A ROS map.yaml or an OctoMap .bt or .ot, instead of the one found next to the graph."""
    heights: Inline[Heights] = field(default_factory=Heights)
    dry_run: bool = False
    """Report the changes without making them."""
    out: Path | None = None
    """Write the result to this connectivity file and do not change the graph."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.cli.commands.graph_edit import report
    from nvsim.cli.graph_target import GraphTarget, refused_as_input
    from nvsim.graph.history import History, counted
    from nvsim.graph.operations import parse_line, perform
    from nvsim.graph.scripts import script_lines

    target = GraphTarget(arguments.graph, arguments.occupancy, arguments.heights)
    lines = script_lines(arguments.script)
    surroundings = target.surroundings()

    def play(history: History) -> str:
        count = 0
        for number, line in enumerate(lines, 1):
            if line.strip() and not line.lstrip().startswith("#"):
                with refused_as_input(f"{arguments.script}, line {number}: "):
                    perform(history, *parse_line(line), surroundings=surroundings)
                count += 1
        return f"Replay {counted(count, 'edit')}"

    if arguments.dry_run or arguments.out is not None:
        history = History(target.read())
        before = history.graph
        words = play(history)
        written = None if arguments.dry_run else target.write(history.graph, arguments.out)
    else:
        with target.editing() as history:
            before = history.graph
            words = play(history)
        written = None if history.graph is before else target.path
    original = target.original if written == target.path else None
    report(before, history.graph, words, written, arguments.json, original)
    return 0
