"""An export that the agents' programs would break on is refused, with the finding that says why."""

from __future__ import annotations

from nvsim.errors import InputError
from nvsim.graph.findings import BLOCKS_EXPORT, Context, Finding, check_graph
from nvsim.graph.types import NavGraph


def choking(graph: NavGraph, context: Context | None = None) -> list[Finding]:
    """The findings that break the programs which read R2R files, less those that a user ignores for a reason."""
    found = check_graph(graph, context or Context())
    return [f for f in found if f.kind in BLOCKS_EXPORT and f.severity == "error" and f.key not in graph.ignored]


def refuse(graph: NavGraph, context: Context | None = None) -> None:
    """Raises InputError with the first of `choking`, and how many more there are."""
    found = choking(graph, context)
    if found:
        more = f" (and {len(found) - 1} more that `nvsim graph check` lists)" if len(found) > 1 else ""
        raise InputError(
            f"{found[0].message.rstrip('.')}{more}; mend that, or write the files all the same with --force."
        )
