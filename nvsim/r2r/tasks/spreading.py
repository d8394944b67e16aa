"""Choosing paths so that they are spread over a building: next always the one whose viewpoints were used the least."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Hashable, Iterator, Sequence
from random import Random


def spread(paths: Sequence[Sequence[Hashable]], random: Random) -> Iterator[int]:
    """The indices of all `paths`, each once. Next comes the path of the least use: how often, on average, its
    viewpoints were passed already, and how often its ends were ends. Between equals `random` decides."""
    passed: Counter[Hashable] = Counter()
    ends: Counter[Hashable] = Counter()

    def use(path: Sequence[Hashable]) -> float:
        return sum(passed[v] for v in path) / len(path) + (ends[path[0]] + ends[path[-1]]) / 2

    # Use only grows: who was the least used and still is as much used is the least used.
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
