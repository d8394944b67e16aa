"""Distances in meters between all viewpoints of a scan along its graph, the basis of every metric."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from nvsim.errors import InputError, value_text
from nvsim.graph.paths import PathGraph
from nvsim.graph.types import NavGraph
from nvsim.r2r.tasks.task import Task


class Distances:
    """Distances between the included viewpoints of a graph.

    row      viewpoint id -> row
    meters   (N, N) float64, meters, length of the shortest path; an edge is as long as its straight line; infinite if
             there is no path
    joined   (N, N) bool, whether an edge joins two viewpoints; True for a viewpoint and itself
    """

    def __init__(self, graph: NavGraph) -> None:
        ways = PathGraph.of(graph)
        count = len(ways.ids)
        self.row = {id: i for i, id in enumerate(ways.ids)}
        self.meters = ways.lengths(np.arange(count)).reshape(count, count)
        self.joined = np.eye(count, dtype=bool)
        self.joined[ways.ends[:, 0], ways.ends[:, 1]] = self.joined[ways.ends[:, 1], ways.ends[:, 0]] = True

    def find_invalid_step(self, path: Sequence[str]) -> str:
        """Returns a message about the first unknown viewpoint or missing edge, or "" if the path is valid."""
        for id in path:
            if id not in self.row:
                return f"the viewpoint {value_text(id)} is not in the graph of the scan"
        for a, b in pairwise(path):
            if not self.joined[self.row[a], self.row[b]]:
                return f"no edge leads from {value_text(a)} to {value_text(b)}"
        return ""


def check_tasks(tasks: Sequence[Task], distances: Mapping[str, Distances], where: object) -> None:
    """Checks that every path has a goal and is in its graph. `where` names the source of the tasks.

    Raises InputError for the first task that fails.
    """
    for task in tasks:
        if len(task.path) < 2:
            raise InputError(
                f"{where}: path_id {task.path_id} has a start and no goal, as in R2R's test split; name a split with "
                "whole paths."
            )
        wrong = distances[task.scan].find_invalid_step(task.path)
        if wrong:
            raise InputError(f"{where}: path_id {task.path_id}: {wrong}; give the scans that the tasks were made from.")
