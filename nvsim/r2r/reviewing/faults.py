"""Finds tasks that do not fit the current graph: their paths are missing in it, or are not shortest paths."""

from __future__ import annotations

from nvsim.graph.ways import SAME_LENGTH
from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.tasks.task import JoinedTask, Task


def fault(task: Task, distances: Distances) -> str:
    """Returns the reason why `task` does not fit the graph, or "". A joined path need not be a shortest path."""
    wrong = distances.wrong_step(task.path)
    if wrong or isinstance(task, JoinedTask) or len(task.path) < 2:
        return wrong
    rows = [distances.row[id] for id in task.path]
    metres = float(distances.metres[rows[:-1], rows[1:]].sum())
    longer = metres - float(distances.metres[rows[0], rows[-1]])
    return f"a path {longer:.2f} m shorter leads to the goal" if longer > SAME_LENGTH else ""
