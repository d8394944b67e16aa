"""Where stairs begin and end, as facts that can be said: who climbs knows without measuring how far."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from nvsim.graph.slopes import Slope
from nvsim.r2r.instructions.cues import Cue


def stair_cues(slopes: Sequence[Sequence[Slope]], leg: Slope) -> Iterator[Cue]:
    """Of a leg that is level, up or down over two viewpoints or more, of each of which the slopes of all its steps are
    given: whether it ends with the stairs, or at their foot or head."""
    before, end = slopes[:-1], slopes[-1]
    if leg != "level":
        if leg not in end and "level" in end:
            yield Cue("stairs", "top" if leg == "up" else "bottom")
        return
    ways = {slope for slope in end if slope != "level"}
    if len(ways) == 1 and not any(ways & set(other) for other in before):
        yield Cue("to stairs", ways.pop())
