"""Refuse an export that R2R programs cannot read, with the finding that is the reason."""

from __future__ import annotations

from collections.abc import Mapping

from nvsim.errors import InputError
from nvsim.graph.findings import BLOCKS_EXPORT, Context, Finding, check_graph
from nvsim.graph.types import NavGraph


class Refusal(InputError):
    """A refused export. The message contains the fix; `reason` is the message without it."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; fix this, or write the files anyway with --force.")
        self.reason = reason


def choking(graph: NavGraph, context: Context | None = None) -> list[Finding]:
    """Return the findings that break programs for R2R files, except those that a user ignores for a reason."""
    found = check_graph(graph, context or Context())
    return [f for f in found if f.kind in BLOCKS_EXPORT and f.severity == "error" and f.key not in graph.ignored]


def refuse(graph: NavGraph, context: Context | None = None) -> None:
    """Check a graph before an export. Raises Refusal with the first finding of `choking` and the number of the
    others."""
    found = choking(graph, context)
    if found:
        more = f" (and {len(found) - 1} more that `nvsim graph check` lists)" if len(found) > 1 else ""
        raise Refusal(f"{found[0].message.rstrip('.')}{more}")


def left_out(failures: Mapping[str, InputError], count: int) -> InputError:
    """Return one error for the scans that could not be written, by name. `count` is the number of all scans."""
    reasons = [
        f"{scan}: {error.reason if isinstance(error, Refusal) else str(error).rstrip('.')}"
        for scan, error in failures.items()
    ]
    sentence = f"{len(failures)} of {count} scans were not written ({'; '.join(reasons)}); fix this"
    if any(isinstance(error, Refusal) for error in failures.values()):
        sentence += ", or write them anyway with --force"
    return InputError(f"{sentence}.")
