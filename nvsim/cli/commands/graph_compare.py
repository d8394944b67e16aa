"""Compare two navigation graphs: list the differences of the second from the first. With --out, write the first graph
with the selected differences applied."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    a: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    b: Positional[Path]
    """The second graph, like the first."""
    tolerance: float = 0.3
    """Meters within which viewpoints with different ids match."""
    out: Path | None = None
    """Write the first graph, a connectivity file, with the differences applied, to this connectivity file."""
    take: tuple[str, ...] = ()
    """Kinds of differences to apply, with words joined by a dash as in edge-added. Default: all."""
    json: bool = False
    """Print the differences as JSON."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if a kind is unknown or the graphs cannot be merged."""
    from nvsim.cli import show
    from nvsim.cli.graph_source import one_source
    from nvsim.graph.compare import KINDS, compare, merge
    from nvsim.graph.edits import EditError

    kinds = {kind.replace(" ", "-"): kind for kind in KINDS}
    for word in arguments.take:
        if word not in kinds:
            raise InputError(f"There is no difference {word!r}; --take knows {', '.join(kinds)}.")
    a, b = one_source(arguments.a), one_source(arguments.b)
    found = compare(a.graph, b.graph, arguments.tolerance)
    if arguments.json:
        rows = [asdict(d) for d in found.deviations]
        say(as_json({**found.counts(), "matched": len(found.matched), "differences": rows}))
    else:
        title = f"{len(found.matched)} viewpoints matched, {len(found.by_place)} of them by place"
        rows_of = [(d.kind, d.words) for d in found.deviations]
        show.table(("what", "difference"), rows_of, title) if rows_of else say(f"{title}; no difference")
    if arguments.out is not None:
        from nvsim.cli.graph_source import is_project
        from nvsim.graph.foreign import ForeignFile

        if is_project(arguments.a):
            raise InputError(f"{arguments.a} is a project; export it with `nvsim export r2r` and merge into the file.")
        wanted = {kinds[word] for word in arguments.take} or set(KINDS)
        try:
            merged = merge(a.graph, b.graph, found, [d for d in found.deviations if d.kind in wanted])
        except EditError as error:
            raise InputError(f"The graphs cannot be merged in this way: {error}") from error
        ForeignFile.open(a.path).save(merged, arguments.out)
    return 0
