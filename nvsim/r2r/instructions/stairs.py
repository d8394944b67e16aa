"""Cues for the begin and end of stairs, which replace a distance for the follower."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from nvsim.graph.slopes import Slope
from nvsim.r2r.instructions.cues import Cue


def stair_cues(slopes: Sequence[Sequence[Slope]], leg: Slope) -> Iterator[Cue]:
    """Yields a cue if a leg ends where stairs end or begin.

    slopes   for each viewpoint of the leg (two or more), the slopes of all its steps
    leg      slope of the leg
    """
    before, end = slopes[:-1], slopes[-1]
    if leg != "level":
        if leg not in end and "level" in end:
            yield Cue("stairs", "top" if leg == "up" else "bottom")
        return
    ways = {slope for slope in end if slope != "level"}
    if len(ways) == 1 and not any(ways & set(other) for other in before):
        yield Cue("to stairs", ways.pop())
