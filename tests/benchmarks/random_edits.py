"""Random edits, shared by the benchmarks that stress the graph editor."""

from __future__ import annotations

import random

from nvsim.graph.edits import EditError
from nvsim.graph.history import History
from nvsim.graph.operations import perform_operation
from nvsim.graph.selection import selection
from nvsim.graph.types import NavGraph


def random_edit(history: History, rng: random.Random) -> bool:
    """Performs one random step: an edit, a selection, an undo, or a redo. Returns whether the step had an effect."""
    graph = history.graph
    ids = list(graph.viewpoints)
    some = rng.sample(ids, min(len(ids), rng.randint(1, 5)))
    kind = rng.randrange(14)
    if kind == 0:
        return history.undo()
    if kind == 1:
        return history.redo()
    if kind == 2 or not ids:
        history.select(selection(some))
        return True
    if kind == 3:
        return history.go_to(rng.randrange(len(history.steps)))
    name, arguments = _operation(graph, some, kind, rng)
    try:
        before = history.graph
        perform_operation(
            history, name, arguments, merge="drag" if name == "shift_viewpoints" and rng.random() < 0.5 else None
        )
    except EditError:
        return False
    return history.graph is not before


def _operation(graph: NavGraph, some: list[str], kind: int, rng: random.Random) -> tuple[str, dict[str, object]]:
    x, y, z = graph.viewpoints[some[0]].position
    keys = [(some[0], other) for other in graph.neighbours(some[0])]
    place = [x + rng.uniform(-2, 2), y + rng.uniform(-2, 2), z]
    if kind == 4:
        return "add_viewpoint", {"position": place, "height": rng.choice([1.2, 1.5])}
    if kind == 5 and keys:
        return "split_edge", {"edge": list(keys[0]), "share": rng.uniform(0.1, 0.9)}
    if kind == 6:
        return "remove_viewpoints", {"ids": some[:2]}
    if kind == 7:
        return "merge_viewpoints", {"ids": some, "middle": rng.random() < 0.5}
    if kind == 8 and keys:
        return "remove_edges", {"pairs": [list(key) for key in keys[:2]]}
    if kind == 9:
        return "add_edges", {"pairs": [[some[0], some[-1]]]}
    if kind == 10:
        return "lock", {"viewpoints": some[:1], "edges": [list(k) for k in keys[:1]], "locked": rng.random() < 0.3}
    if kind == 11:
        return "mark_reviewed", {"viewpoints": some, "edges": [list(k) for k in keys]}
    if kind == 12:
        return "include", {"ids": some, "included": rng.random() < 0.5}
    return "shift_viewpoints", {"ids": some, "by": [rng.uniform(-1, 1), rng.uniform(-1, 1), 0.0]}
