"""How the cores of several machines are shared among pieces of work."""

from __future__ import annotations

from collections.abc import Sequence


def threads_each(machines: Sequence[int], pieces: int) -> int:
    """The most threads with which `pieces` pieces run at once on machines of so many cores each; 1 where they are more
    than the cores. A piece lies on one machine, and two pieces of half the threads are done sooner than one after the
    other."""
    most = max(machines, default=1)
    wanted = min(max(1, pieces), sum(machines))
    return next((t for t in range(most, 0, -1) if places(machines, t) >= wanted), 1)


def places(machines: Sequence[int], threads: int) -> int:
    """How many pieces of so many threads have room at once."""
    return sum(cores // threads for cores in machines)
