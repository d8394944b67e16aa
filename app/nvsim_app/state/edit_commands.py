"""The edits of the graph that users make in a view. Each edit is one step and selects its result."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from nvsim.graph.edits import new_id
from nvsim.graph.selection import NOTHING, GraphSelection
from nvsim.plain_text import count_text

if TYPE_CHECKING:
    from nvsim_app.state.editing import Editing

EYE = 1.5  # default height of viewpoints above the floor, meters

Place = tuple[float, float, float]


def eye_height(editing: Editing) -> float:
    """Height of a new viewpoint above the floor in meters: the median of up to 99 viewpoints, or EYE if there are
    none."""
    graph = editing.graph
    if graph is None or not graph.viewpoints:
        return EYE
    some = [v.height for v, _ in zip(graph.viewpoints.values(), range(99), strict=False)]
    return sorted(some)[len(some) // 2]


def add_viewpoint(editing: Editing, position: Place, join: str | None = None) -> None:
    """Adds a viewpoint whose camera is at `position` (meters, world), with an edge to `join` if given."""
    if editing.graph is None:
        return
    id = new_id(editing.graph, position)
    steps: list[tuple[str, dict[str, Any]]] = [
        ("add_viewpoint", {"position": list(position), "height": eye_height(editing), "id": id})
    ]
    if join is not None:
        steps.append(("add_edges", {"pairs": [[join, id]]}))
    words = "Add a viewpoint with an edge" if join is not None else ""
    editing.run_all(steps, words, selection=GraphSelection(frozenset({id})))


def add_viewpoint_on_floor(editing: Editing, foot: Place, join: str | None = None) -> None:
    """Adds a viewpoint above the floor point `foot` (meters, world), at the height of the others."""
    x, y, z = foot
    add_viewpoint(editing, (x, y, z + eye_height(editing)), join)


def split_edge(editing: Editing, edge: tuple[str, str], share: float) -> None:
    """Splits an edge into two with a new viewpoint at `share` (0 to 1) of its length."""
    graph = editing.graph
    if graph is None or any(end not in graph.viewpoints for end in edge):
        return
    a, b = (graph.viewpoints[end].position for end in edge)
    x, y, z = (p + share * (q - p) for p, q in zip(a, b, strict=True))
    id = new_id(graph, (x, y, z))
    arguments = {"edge": list(edge), "share": share, "id": id}
    editing.run("split_edge", arguments, selection=GraphSelection(frozenset({id})))


def add_edge(editing: Editing, a: str, b: str) -> None:
    """Adds an edge and selects it."""
    key = (min(a, b), max(a, b))
    editing.run("add_edges", {"pairs": [[a, b]]}, selection=GraphSelection(frozenset(), frozenset({key})))


def move(editing: Editing, ids: Iterable[str], offset: Place, merge: str | None = None) -> None:
    """Moves viewpoints by `offset` (meters, world). Moves with an equal merge key become one step."""
    editing.run("shift_viewpoints", {"ids": list(ids), "by": list(offset)}, merge=merge)


def remove_selection(editing: Editing) -> None:
    """Removes the selected viewpoints with their edges, and the selected edges."""
    graph, chosen = editing.graph, editing.selection
    if graph is None:
        return
    edges = sorted(key for key in chosen.edges if not chosen.viewpoints.intersection(key))
    steps: list[tuple[str, dict[str, Any]]] = []
    if chosen.viewpoints:
        steps.append(("remove_viewpoints", {"ids": [id for id in graph.viewpoints if id in chosen.viewpoints]}))
    if edges:
        steps.append(("remove_edges", {"pairs": [list(key) for key in edges]}))
    if steps:
        words = f"Remove {count_text(len(chosen.viewpoints), 'viewpoint')} and {count_text(len(edges), 'edge')}"
        editing.run_all(steps, words if len(steps) > 1 else "", selection=NOTHING)
