"""Spreads paths over a building, and joins two paths as in R4R.

The first path ends near the start of the second, and the shortest path connects them.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import islice
from random import Random

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.paths import PathGraph
from nvsim.r2r.tasks.shortest import ShortestPaths, ShortestPathTree
from nvsim.r2r.tasks.task import JoinedTask, Task

NEAR = 3.0
"""Largest distance in meters along the graph from the goal of the first path to the start of the second (Jain et al.
2019, section 4)."""


def by_increasing_use(paths: Sequence[Sequence[Hashable]], random: Random) -> Iterator[int]:
    """Yields the indices of all `paths`, each once, by increasing use.

    The use of a path is the mean number of earlier paths through its viewpoints, plus the mean number of earlier ends
    at its ends. `random` decides ties.
    """
    passed: Counter[Hashable] = Counter()
    ends: Counter[Hashable] = Counter()

    def use(path: Sequence[Hashable]) -> float:
        return sum(passed[v] for v in path) / len(path) + (ends[path[0]] + ends[path[-1]]) / 2

    # The use of a path only grows. If the path with the smallest stored use is up to date, it is the least used.
    waiting = [(0.0, random.random(), i) for i in range(len(paths))]
    heapq.heapify(waiting)
    while waiting:
        then, tie, i = heapq.heappop(waiting)
        now = use(paths[i])
        if now > then:
            heapq.heappush(waiting, (now, tie, i))
            continue
        passed.update(paths[i])
        ends.update((paths[i][0], paths[i][-1]))
        yield i


def join_tasks(
    tasks: Sequence[Task],
    ways: Mapping[str, PathGraph],
    allowed: Mapping[str, NDArray[np.bool_]],
    count: int,
    first_id: int,
    random: Random,
) -> list[JoinedTask]:
    """Returns up to `count` joined paths of the tasks of a split, spread over the building.

    ways      scan id -> its viewpoints and edges
    allowed   scan id -> (N,) bool, viewpoints that the split may enter
    first_id  path_id of the first joined path; the others follow
    """
    found = [joined for scan in ways for joined in _of_scan(tasks, scan, ways[scan], allowed[scan])]
    chosen = islice(by_increasing_use([[(task.scan, v) for v in task.path] for task in found], random), count)
    return [replace(found[i], path_id=first_id + k) for k, i in enumerate(chosen)]


def joined_instructions(first: Task, second: Task) -> tuple[str, ...]:
    """Combines every instruction of the first path with every instruction of the second."""
    return tuple(f"{a} {b}" for a in first.instructions for b in second.instructions)


def _of_scan(tasks: Sequence[Task], scan: str, ways: PathGraph, allowed: NDArray[np.bool_]) -> Iterator[JoinedTask]:
    row = {id: i for i, id in enumerate(ways.ids)}
    shortest = ShortestPaths(ways)

    @cache
    def tree(start: str) -> ShortestPathTree:
        return shortest.tree(row[start])

    mine = [task for task in tasks if task.scan == scan]
    for second in mine:
        start = tree(second.path[0])
        for first in mine:
            goal = row[first.path[-1]]
            if first is second or start.metres[goal] > NEAR:
                continue
            between = start.back_from(goal)
            if not allowed[between].all():
                continue
            path = (*first.path[:-1], *(ways.ids[i] for i in between), *second.path[1:])
            whole = tree(first.path[0])
            end = row[second.path[-1]]
            yield JoinedTask(
                path_id=0,
                scan=scan,
                path=path,
                heading=first.heading,
                instructions=joined_instructions(first, second),
                distance=round((first.distance or 0.0) + float(start.metres[goal]) + (second.distance or 0.0), 2),
                first_path_id=first.path_id,
                second_path_id=second.path_id,
                shortest_path=tuple(ways.ids[i] for i in reversed(whole.back_from(end))),
                shortest_path_distance=round(float(whole.metres[end]), 2),
            )
