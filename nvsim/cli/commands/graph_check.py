"""List the problems that a navigation graph has for agents or users: of a project, of any R2R connectivity file, or of
every scan in a folder of them. Exits with code 1 if there are errors."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say
from nvsim.graph.findings import Limits
from nvsim.occupancy.heights import Heights


@dataclass(frozen=True)
class Arguments:
    graph: Positional[Path]
    """A project, NAME.nvsim, an R2R connectivity file, or a folder of them with scans.txt."""
    occupancy: Path | None = None
    """A ROS map.yaml or an OctoMap .bt or .ot, instead of the one found next to the graph."""
    heights: Inline[Heights] = field(default_factory=Heights)
    ignored: bool = False
    """Also show findings that a user chose to ignore."""
    json: bool = False
    """Print the findings as JSON."""
    limits: Inline[Limits] = field(default_factory=Limits)


def run(arguments: Arguments) -> int:
    from nvsim.cli import show
    from nvsim.cli.graph_source import sources
    from nvsim.graph.findings import check_graph

    report: list[dict[str, Any]] = []
    for source in sources(arguments.graph, arguments.limits, arguments.occupancy, arguments.heights):
        found = check_graph(source.graph, source.context)
        hidden = [f for f in found if f.ignored_by(source.graph.ignored)]
        shown = found if arguments.ignored else [f for f in found if not f.ignored_by(source.graph.ignored)]
        counts = {s: sum(f.severity == s for f in found if f not in hidden) for s in ("error", "warning", "notice")}
        report.append(
            {
                "scan": source.name,
                **counts,
                "ignored": len(hidden),
                "findings": [
                    {
                        "key": f.key,
                        "kind": f.kind,
                        "severity": f.severity,
                        "message": f.message,
                        "viewpoints": f.viewpoints,
                        "edges": f.edges,
                        "ignored": source.graph.ignored.get(f.ignored_by(source.graph.ignored) or ""),
                        "fixes": [{"text": x.text, "edit": x.operation, **x.arguments} for x in f.fixes],
                    }
                    for f in shown
                ],
            }
        )
        if not arguments.json:
            title = f"{source.name}: {_counted(counts)}" + (f", {len(hidden)} ignored" if hidden else "")
            rows = [(f.severity, f.message, f.fixes[0].text if f.fixes else "") for f in shown]
            show.table(("severity", "finding", "fix"), rows, title) if rows else say(title)
    if arguments.json:
        say(as_json(report))
    return 1 if any(scan["error"] for scan in report) else 0


def _counted(counts: dict[str, int]) -> str:
    words = [f"{n} {severity}{'' if n == 1 else 's'}" for severity, n in counts.items() if n]
    return ", ".join(words) or "nothing found"
