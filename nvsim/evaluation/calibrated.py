"""The result of `nvsim.evaluation.calibration`. A separate module, because the window shows it without computing it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from nvsim.evaluation.interval import needed

Judge = Literal["point", "robot"]


@dataclass(frozen=True, eq=False)
class Calibration:
    """A JSON-able calibration result.

    want        the requested validity
    now         metrics with the current thresholds
    sweeps      threshold name -> one row of metrics per value, with the other thresholds unchanged
    suggested   for each threshold, and for a point and a robot: the loosest value that reaches `want`, and its effect
                on the graph. `threshold` is None if no value reaches it

    A row contains threshold, corridors, accepted and its share; valid, validity, low and high (its 95 % interval); and
    recall, the share of free corridors that is accepted. The names with _robot give these metrics for a robot.
    viewpoints, edges and coverage describe the remaining graph. beyond counts newly open steps towards places without a
    viewpoint, which only a new build can add.
    """

    want: float
    now: dict[str, Any]
    sweeps: dict[str, list[dict[str, Any]]]
    suggested: list[dict[str, Any]]

    @property
    def why_none(self) -> str:
        """A sentence about the number of corridors that a suggestion needs. "" if every threshold has a suggestion."""
        if all(row["threshold"] is not None for row in self.suggested):
            return ""
        return (
            f"A lower bound of {self.want:g} needs at least {needed(self.want)} accepted corridors, all of them free; "
            f"{self.now['accepted']} are accepted. Give a lower --want, or map a larger area."
        )
