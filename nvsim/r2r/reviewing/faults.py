"""Which tasks the graph as it is now breaks: paths that cannot be walked any more, or are no longer shortest."""

from __future__ import annotations

from nvsim.graph.ways import SAME_LENGTH
from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.tasks.task import JoinedTask, Task


def fault(task: Task, distances: Distances) -> str:
    """Why `task` is broken in the graph of `distances`; "" where it is not. A joined path may be longer than needed."""
    wrong = distances.wrong_step(task.path)
    if wrong or isinstance(task, JoinedTask) or len(task.path) < 2:
        return wrong
    rows = [distances.row[id] for id in task.path]
    metres = float(distances.metres[rows[:-1], rows[1:]].sum())
    longer = metres - float(distances.metres[rows[0], rows[-1]])
    return f"a way {longer:.2f} m shorter leads to the goal" if longer > SAME_LENGTH else ""
