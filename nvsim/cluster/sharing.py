"""Divides the cores of several machines among pieces of work."""

from __future__ import annotations

from collections.abc import Sequence


def threads_each(machines: Sequence[int], pieces: int) -> int:
    """The largest number of threads with which `pieces` pieces can run at once on machines with these core counts; 1 if
    there are more pieces than cores. A piece runs on one machine. Two pieces in parallel with half the threads each
    finish sooner than one after the other."""
    most = max(machines, default=1)
    wanted = min(max(1, pieces), sum(machines))
    return next((t for t in range(most, 0, -1) if places(machines, t) >= wanted), 1)


def places(machines: Sequence[int], threads: int) -> int:
    """The number of pieces with `threads` threads that can run at once."""
    return sum(cores // threads for cores in machines)
