"""The summary at the end of `nvsim run` and `nvsim demo`: the graph, its validity if known, files, next steps."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from nvsim.cli import window
from nvsim.graph.components import components
from nvsim.project.project import Project


def summary(project: Project) -> list[str]:
    """The lines of the summary. Raises InputError if the project has no graph."""
    graph = project.need_graph()
    parts = components(graph)
    included = {id for part in parts for id in part}
    edges = sum(a in included and b in included for a, b in graph.edges)
    figures = _current_figures(project, len(included), edges)
    root = project.layout.root
    name = shlex.quote(str(root))
    quality = _quality(figures) if figures else [("Validity", "not measured, because it needs an occupancy map")]
    files = [
        (str(project.layout.models), "trained models; their PLY files open in any splat viewer"),
        (str(project.layout.masks), "floor masks"),
        (str(project.layout.database), "navigation graph with its evidence, for NVSim"),
    ]
    steps = [
        (window.command(root), "look at the graph and edit it"),
        (f"nvsim graph check {name}", "list problems of the graph"),
        *([] if figures else [(f"nvsim evaluate graph --project {name} --occupancy map.yaml", "measure validity")]),
        (f"nvsim export r2r --project {name} --out connectivity", "write the graph for agents"),
        (f"nvsim export scan --project {name} --out scans --views", "write the images for agents"),
    ]
    return [
        "",
        f"Navigation graph of {root}",
        *_columns([*_size(parts, edges), *quality]),
        "",
        "Files",
        *_columns(files),
        "",
        "Next steps",
        *_columns(steps),
    ]


def _current_figures(project: Project, nodes: int, edges: int) -> Mapping[str, Any] | None:
    """The figures of the last evaluation of the graph. None if the map was built or edited after it."""
    built = getattr(project.stage_results().part("map"), "finished", 0.0)
    measured = project.result_times().get("graph")
    if measured is None or measured < built:
        return None
    figures = project.results()["graph"]
    return figures if (figures.get("nodes"), figures.get("edges")) == (nodes, edges) else None


def _size(parts: list[list[str]], edges: int) -> list[tuple[str, str]]:
    rows = [("Viewpoints", str(sum(map(len, parts)))), ("Edges", str(edges))]
    if len(parts) > 1:
        rows.append(("Connected", f"no: {len(parts)} separate parts, the largest with {len(parts[0])} viewpoints"))
    elif parts:
        rows.append(("Connected", "yes: every viewpoint can be reached from every other"))
    return rows


def _quality(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows = [
        ("Valid viewpoints", _share(figures, "node_validity")),
        ("Valid edges", _share(figures, "edge_validity")),
        ("Coverage", f"{_percent(figures['coverage'])} of {figures['reachable_m2']:.0f} m² of reachable floor"),
    ]
    if "coverage_seen" in figures:
        seen = f"{_percent(figures['coverage_seen'])} of the {figures['seen_m2']:.0f} m² that the capture shows"
        rows.append(("", seen))
    return rows


def _share(figures: Mapping[str, Any], name: str) -> str:
    if f"{name}_low" not in figures:
        return _percent(figures[name])
    low, high = (_percent(figures[f"{name}_{end}"]) for end in ("low", "high"))
    return f"{_percent(figures[name])} (95 % interval: {low} to {high})"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _columns(rows: list[tuple[str, str]]) -> list[str]:
    width = max(len(left) for left, _ in rows)
    return [f"  {left:<{width}}  {right}" for left, right in rows]
