"""An export that the agents' programs would break on is refused, with the finding that says why."""

from __future__ import annotations

from collections.abc import Mapping

from nvsim.errors import InputError
from nvsim.graph.findings import BLOCKS_EXPORT, Context, Finding, check_graph
from nvsim.graph.types import NavGraph


class Refusal(InputError):
    """The sentence with the way out; `reason` is it without."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; mend that, or write the files all the same with --force.")
        self.reason = reason


def choking(graph: NavGraph, context: Context | None = None) -> list[Finding]:
    """The findings that break the programs which read R2R files, less those that a user ignores for a reason."""
    found = check_graph(graph, context or Context())
    return [f for f in found if f.kind in BLOCKS_EXPORT and f.severity == "error" and f.key not in graph.ignored]


def refuse(graph: NavGraph, context: Context | None = None) -> None:
    """Raises Refusal with the first of `choking`, and how many more there are."""
    found = choking(graph, context)
    if found:
        more = f" (and {len(found) - 1} more that `nvsim graph check` lists)" if len(found) > 1 else ""
        raise Refusal(f"{found[0].message.rstrip('.')}{more}")


def left_out(failures: Mapping[str, InputError], count: int) -> InputError:
    """One error for the scans that could not be written, by name, of `count`; the others were."""
    reasons = [
        f"{scan}: {error.reason if isinstance(error, Refusal) else str(error).rstrip('.')}"
        for scan, error in failures.items()
    ]
    sentence = f"{len(failures)} of {count} scans were not written ({'; '.join(reasons)}); mend that"
    if any(isinstance(error, Refusal) for error in failures.values()):
        sentence += ", or write them all the same with --force"
    return InputError(f"{sentence}.")
