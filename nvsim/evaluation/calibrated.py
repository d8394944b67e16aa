"""What `nvsim.evaluation.calibration` found; apart from it, because the window shows it and computes none of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from nvsim.evaluation.interval import needed

Judge = Literal["point", "robot"]


@dataclass(frozen=True, eq=False)
class Calibration:
    """JSON-able. now: the figures under the thresholds in use. sweeps: threshold's name -> a row of the same figures
    for each of its values, the others at theirs. suggested: for each threshold, and for a point and a robot, the
    loosest value that is good enough and what it costs; `threshold` None where there is none.

    A row: threshold; corridors, accepted and share of them; valid, validity, low and high, its 95 % interval, and
    recall, the share of the free corridors that is accepted; the same with _robot; viewpoints, edges and coverage of
    the graph that is left; beyond: steps that newly open towards places where only a new build would go.
    """

    want: float
    now: dict[str, Any]
    sweeps: dict[str, list[dict[str, Any]]]
    suggested: list[dict[str, Any]]

    @property
    def why_none(self) -> str:
        """A sentence about how many corridors a suggestion needs, "" where every threshold has one."""
        if all(row["threshold"] is not None for row in self.suggested):
            return ""
        return (
            f"A lower bound of {self.want:g} needs at least {needed(self.want)} accepted corridors, all of them free; "
            f"{self.now['accepted']} are accepted now. A lower --want, or more ground, gives an answer."
        )
