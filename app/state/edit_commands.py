"""What a hand does to the graph in a view: each of these is one step, after which what was made is selected."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from nvsim.graph.edits import new_id
from nvsim.graph.history import counted
from nvsim.graph.selection import NOTHING, GraphSelection

if TYPE_CHECKING:
    from app.state.editing import Editing

EYE = 1.5  # metres above the floor, of a viewpoint that nobody gave another height

Place = tuple[float, float, float]


def eye_height(editing: Editing) -> float:
    """Metres above the floor at which a new viewpoint stands: as the others do."""
    graph = editing.graph
    if graph is None or not graph.viewpoints:
        return EYE
    some = [v.height for v, _ in zip(graph.viewpoints.values(), range(99), strict=False)]
    return sorted(some)[len(some) // 2]


def add_viewpoint(editing: Editing, position: Place, join: str | None = None) -> None:
    """A viewpoint whose camera stands at `position`, joined to another where one is named."""
    if editing.graph is None:
        return
    id = new_id(editing.graph, position)
    steps: list[tuple[str, dict[str, Any]]] = [
        ("add_viewpoint", {"position": list(position), "height": eye_height(editing), "id": id})
    ]
    if join is not None:
        steps.append(("add_edges", {"pairs": [[join, id]]}))
    words = "Add a viewpoint and join it" if join is not None else ""
    editing.run_all(steps, words, selection=GraphSelection(frozenset({id})))


def add_viewpoint_on_floor(editing: Editing, foot: Place, join: str | None = None) -> None:
    """A viewpoint that stands on the floor at `foot`, as high as the others."""
    x, y, z = foot
    add_viewpoint(editing, (x, y, z + eye_height(editing)), join)


def split_edge(editing: Editing, edge: tuple[str, str], share: float) -> None:
    """A viewpoint on the edge, that far along it; the edge becomes two."""
    graph = editing.graph
    if graph is None or any(end not in graph.viewpoints for end in edge):
        return
    a, b = (graph.viewpoints[end].position for end in edge)
    x, y, z = (p + share * (q - p) for p, q in zip(a, b, strict=True))
    id = new_id(graph, (x, y, z))
    arguments = {"edge": list(edge), "share": share, "id": id}
    editing.run("split_edge", arguments, selection=GraphSelection(frozenset({id})))


def add_edge(editing: Editing, a: str, b: str) -> None:
    """The edge is selected afterwards."""
    key = (min(a, b), max(a, b))
    editing.run("add_edges", {"pairs": [[a, b]]}, selection=GraphSelection(frozenset(), frozenset({key})))


def move(editing: Editing, ids: Iterable[str], offset: Place, merge: str | None = None) -> None:
    """All of them by the same metres. With a merge key a series of moves is one step."""
    editing.run("shift_viewpoints", {"ids": list(ids), "by": list(offset)}, merge=merge)


def remove_selection(editing: Editing) -> None:
    """The selected viewpoints with their edges, and the selected edges."""
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
        words = f"Remove {counted(len(chosen.viewpoints), 'viewpoint')} and {counted(len(edges), 'edge')}"
        editing.run_all(steps, words if len(steps) > 1 else "", selection=NOTHING)
