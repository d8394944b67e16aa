"""Spreads paths over a building by always selecting the path whose viewpoints were used least."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Hashable, Iterator, Sequence
from random import Random


def spread(paths: Sequence[Sequence[Hashable]], random: Random) -> Iterator[int]:
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
