"""Commands that check, complete, compare and measure a navigation graph."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsim.cli import terminal
from nvsim.cli.arguments import Inline, Memory, Positional, ProjectArguments, memory_budget
from nvsim.cli.terminal import as_json, print_lines
from nvsim.errors import InputError
from nvsim.graph.edits import EditError
from nvsim.graph.findings import Limits, check_graph
from nvsim.mapping.config import MappingConfig
from nvsim.occupancy.types import Heights

if TYPE_CHECKING:
    from nvsim.events import Listener
    from nvsim.graph.proposals import EdgeProposal, PlaceProposal
    from nvsim.graph.types import NavGraph
    from nvsim.project.project import Project


@dataclass(frozen=True)
class GraphCheck:
    """List the problems that a navigation graph has for agents or users: of a project, of any R2R connectivity file, or
    of every scan in a folder of them except the stub that agents need. Exits with code 1 if there are errors."""

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

    def run(self) -> int:
        from nvsim.cli.graph_target import sources
        from nvsim.r2r.observations.stub import is_stub

        report: list[dict[str, Any]] = []
        for source in sources(self.graph, self.limits, self.occupancy, self.heights):
            if self.graph.is_dir() and is_stub(source.graph):
                continue  # agents only compute angles with it
            found = check_graph(source.graph, source.context)
            hidden = [f for f in found if f.ignored_by(source.graph.ignored)]
            shown = found if self.ignored else [f for f in found if not f.ignored_by(source.graph.ignored)]
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
            if not self.json:
                title = f"{source.name}: {_count_text(counts)}" + (f", {len(hidden)} ignored" if hidden else "")
                rows = [(f.severity, f.message, f.fixes[0].text if f.fixes else "") for f in shown]
                terminal.table(("severity", "finding", "fix"), rows, title) if rows else print_lines(title)
        if self.json:
            print_lines(as_json(report))
        return 1 if any(scan["error"] for scan in report) else 0


def _count_text(counts: dict[str, int]) -> str:
    words = [f"{n} {severity}{'' if n == 1 else 's'}" for severity, n in counts.items() if n]
    return ", ".join(words) or "nothing found"


@dataclass(frozen=True)
class GraphPropose:
    """Propose edges and viewpoints that a navigation graph lacks: of a project, or of any R2R connectivity file with a
    map.

    With --script, the proposals are written as a script of edits. Delete the lines that are wrong, and run the rest
    with `nvsim graph replay`.
    """

    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    occupancy: Path | None = None
    """A ROS map.yaml or an OctoMap .bt or .ot, instead of the one found next to the graph."""
    heights: Inline[Heights] = field(default_factory=Heights)
    reach: float = 3.5
    """Maximum length of proposed edges in meters."""
    sees: float = 3.0
    """Meters. If floor is farther than this from every viewpoint that sees it, a viewpoint is proposed."""
    robot_radius: float = 0.25
    """Radius of the robot in meters."""
    count: int = 20
    """Maximum number of proposed edges, and of proposed viewpoints."""
    script: Path | None = None
    """Write the proposals as JSON lines into this file, for `nvsim graph replay`."""
    json: bool = False
    """Print the proposals as JSON."""

    def run(self) -> int:
        """Runs the command. Raises InputError if a distance is out of range, or if there is no evidence and no map."""

        from nvsim.cli.graph_target import read_one_graph
        from nvsim.graph.proposals import propose_edges, propose_viewpoints
        from nvsim.graph.scripts import write_script

        for name in ("reach", "sees"):
            if not 0 < getattr(self, name) < 100:
                raise InputError(f"--{name} is {getattr(self, name)}; it must be between 0 and 100 meters.")
        source = read_one_graph(self.graph, self.occupancy, self.heights)
        if source.occupancy is None and source.margin is None and source.visible is None:
            raise InputError(f"{self.graph} has no evidence and no map for proposals; name a map with --occupancy.")
        seen = source.visible if source.occupancy is None else None
        count, radius = max(0, self.count), max(0.0, self.robot_radius)
        edges = propose_edges(
            source.graph, source.occupancy, source.margin, visible=seen, reach=self.reach, radius=radius
        )[:count]
        places: tuple[PlaceProposal, ...] = ()
        if source.occupancy is not None:
            places = propose_viewpoints(
                source.graph, source.occupancy, sees=self.sees, radius=radius, reach=self.reach, most=count
            )
        if self.script is not None:
            write_script(self.script, _script(edges, places))
        if self.json:
            print_lines(
                as_json(
                    {
                        "edges": [_proposal_as_json(e) for e in edges],
                        "viewpoints": [_proposal_as_json(p) for p in places],
                    }
                )
            )
        else:
            rows = [(*map(source.graph.short, e.edge), f"{e.score:.2f}", e.words) for e in edges]
            at = [(f"{p.position[0]:.2f}, {p.position[1]:.2f}", f"{p.score:.2f}", p.words) for p in places]
            for thing, head, lines in (("edge", ("from", "to"), rows), ("viewpoint", ("place",), at)):
                title = f"{len(lines)} {thing}{'' if len(lines) == 1 else 's'} proposed"
                terminal.table((*head, "score", "why"), lines, title) if lines else print_lines(title)
        return 0


def _script(edges: tuple[EdgeProposal, ...], places: tuple[PlaceProposal, ...]) -> Iterator[str]:
    """The edits: one per edge, and each viewpoint followed by its edges. A comment before each gives the reason."""
    from nvsim.graph.operations import record
    from nvsim.graph.scripts import comment

    for e in edges:
        yield comment(e.words)
        yield json.dumps(record("add_edges", {"pairs": [e.edge]}))
    for p in places:
        yield comment(p.words)
        yield json.dumps(record("add_viewpoint", {"position": p.position, "height": p.height, "id": p.new_id}))
        if p.joins:
            yield json.dumps(record("add_edges", {"pairs": [(p.new_id, other) for other in p.joins]}))


def _proposal_as_json(proposal: EdgeProposal | PlaceProposal) -> dict[str, Any]:
    """The fields of a proposal. JSON has no infinity, so the length of a missing path is null."""
    return {key: None if value == float("inf") else value for key, value in asdict(proposal).items()}


@dataclass(frozen=True)
class GraphReview:
    """List the edges that a user should review, the least certain first."""

    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    count: int = 20
    """Number of edges to list."""
    json: bool = False
    """Print the edges as JSON."""

    def run(self) -> int:
        from nvsim.cli.graph_target import read_one_graph
        from nvsim.graph.review import Review

        source = read_one_graph(self.graph)
        order = Review(source.margin).order(source.graph)
        first = order[: max(0, self.count)]
        if self.json:
            rows = [{"edge": d.edge, "margin": None if math.isnan(d.margin) else d.margin, "why": d.why} for d in first]
            print_lines(as_json({"unreviewed": len(order), "edges": rows}))
            return 0
        rows_of = [(*map(source.graph.short, d.edge), d.why) for d in first]
        terminal.table(("from", "to", "why"), rows_of, f"{len(order)} edges are not reviewed")
        return 0


@dataclass(frozen=True)
class GraphCompare:
    """Compare two navigation graphs: list the differences of the second from the first. With --out, write the first
    graph with the selected differences applied."""

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

    def run(self) -> int:
        """Runs the command. Raises InputError if a kind is unknown or the graphs cannot be merged."""
        from nvsim.cli.graph_target import read_one_graph
        from nvsim.graph.compare import KINDS, compare, merge

        kinds = {kind.replace(" ", "-"): kind for kind in KINDS}
        for word in self.take:
            if word not in kinds:
                raise InputError(f"There is no difference {word!r}; --take knows {', '.join(kinds)}.")
        a, b = read_one_graph(self.a), read_one_graph(self.b)
        found = compare(a.graph, b.graph, self.tolerance)
        if self.json:
            rows = [asdict(d) for d in found.deviations]
            print_lines(as_json({**found.counts(), "matched": len(found.matched), "differences": rows}))
        else:
            title = f"{len(found.matched)} viewpoints matched, {len(found.by_place)} of them by place"
            rows_of = [(d.kind, d.words) for d in found.deviations]
            terminal.table(("what", "difference"), rows_of, title) if rows_of else print_lines(
                f"{title}; no difference"
            )
        if self.out is not None:
            from nvsim.cli.graph_target import is_project
            from nvsim.graph.foreign import ForeignFile

            if is_project(self.a):
                raise InputError(f"{self.a} is a project; export it with `nvsim export r2r` and merge into the file.")
            wanted = {kinds[word] for word in self.take} or set(KINDS)
            try:
                merged = merge(a.graph, b.graph, found, [d for d in found.deviations if d.kind in wanted])
            except EditError as error:
                raise InputError(f"The graphs cannot be merged in this way: {error}") from error
            ForeignFile.open(a.path).save(merged, self.out)
        return 0


@dataclass(frozen=True)
class GraphEvidence(ProjectArguments):
    """Measure the evidence of viewpoints that were added or moved, and propose or question edges there.

    Without --graph, the project's own graph is used, and the evidence is stored in it. With --graph, a graph file
    written by the window, the project is not changed and the result is written to --out.
    """

    viewpoints: tuple[str, ...] = ()
    """Ids of viewpoints. Default: all that a user added or moved and that were not measured since."""
    graph: Path | None = None
    """A graph file to read instead of the project's graph."""
    out: Path | None = None
    """File for the graph with its new evidence; required with --graph."""
    memory: Memory = None
    """GiB of memory for trained models. Default: a quarter of the machine's memory."""
    config: Inline[MappingConfig] = field(default_factory=MappingConfig)

    def run(self) -> int:
        """Runs the command. Raises InputError if only one of --graph and --out is given."""
        from nvsim.cli.console import event_listener
        from nvsim.cli.session import project_job
        from nvsim.project.project import Project

        if (self.graph is None) != (self.out is None):
            raise InputError("A graph file is read and written: give --graph and --out together, or neither.")
        if self.graph is not None and self.out is not None:
            from nvsim.files.atomic import write_bytes
            from nvsim.files.opening import read_bytes
            from nvsim.graph.store import decode_graph, encode_graph

            blob = read_bytes(self.graph)
            with Project.open(self.project) as project, event_listener(self.json) as listen:
                write_bytes(self.out, encode_graph(_with_measured_edges(self, project, decode_graph(blob), listen)))
            return 0
        with project_job(self.project, "evidence", self.json) as (project, listen):
            project.set_graph(_with_measured_edges(self, project, project.need_graph(), listen))
        return 0


def _with_measured_edges(arguments: GraphEvidence, project: Project, graph: NavGraph, listen: Listener) -> NavGraph:
    from nvsim.events import Done
    from nvsim.mapping.evidence.new_viewpoints import STAGE, with_new_viewpoints
    from nvsim.project.stages.measured import measure, unmeasured_viewpoints

    ids = arguments.viewpoints or tuple(unmeasured_viewpoints(graph))
    found = measure(project, graph, ids, arguments.config, listen, memory_budget(arguments.memory))
    words = f"{len(ids)} viewpoints measured, {len(found.proposed)} edges proposed, {len(found.doubted)} doubted"
    listen(Done(STAGE, words, {"proposed": list(found.proposed), "doubted": list(found.doubted)}))
    if not arguments.json:
        print_lines(as_json({"proposed": found.proposed, "doubted": found.doubted}))
    return with_new_viewpoints(graph, found)
