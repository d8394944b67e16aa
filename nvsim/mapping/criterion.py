"""One criterion of a corridor: a value measured from the evidence, with one threshold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.types import Decision, Evidence
from nvsim.mapping.families import FAMILIES, MEANS

if TYPE_CHECKING:
    from nvsim.mapping.config import MappingConfig

Plane = Literal["alpha", "up", "support", "reach", "mass", "network_up"]
Part = tuple[slice, slice]  # rows and cells of the corridor
FULL: Mapping[Plane, int] = {"alpha": 255, "up": 255, "support": 1, "reach": 255, "mass": 255, "network_up": 255}
"""The stored number that means 1, for each plane of the evidence."""


@dataclass(frozen=True)
class Criterion:
    """One measured value with one threshold.

    field       name of the threshold in MappingConfig
    word        decision if it fails
    name        name of the measured value
    label       label of the slider
    plane       plane of the evidence that it uses
    over        "corridor" takes the mean of all cells, "row" the worst mean of a row, "cell" the worst cell
    below       True if the value must be below the limit, False if it must exceed it
    closed      whether a value at the limit passes
    """

    field: str
    word: Decision
    name: str
    label: str
    plane: Plane
    over: Literal["corridor", "row", "cell"]
    below: bool
    closed: bool = False

    @property
    def family(self) -> str:
        """The name in MappingConfig.criteria that enables it; "" if it is always used."""
        return self.word if self.word in FAMILIES else ""

    def limit(self, config: MappingConfig) -> float:
        return float(getattr(config, self.field))

    @property
    def worst_only(self) -> bool:
        """Whether only the rule "worst" uses it. The rule "mean" uses the criteria that `MEANS` names."""
        return self.field not in MEANS

    def is_used(self, config: MappingConfig) -> bool:
        return (not self.worst_only or config.rule == "worst") and self.chosen(config)

    def chosen(self, config: MappingConfig) -> bool:
        """Whether its family is enabled, under either rule."""
        return not self.family or self.family in config.criteria

    def measured(self, evidence: Evidence) -> bool:
        """Whether the evidence holds its plane."""
        return getattr(evidence, self.plane) is not None

    @overload
    def passes(self, value: float, limit: float) -> bool: ...
    @overload
    def passes(self, value: NDArray[np.floating], limit: float) -> NDArray[np.bool_]: ...
    def passes(self, value: float | NDArray[np.floating], limit: float) -> bool | NDArray[np.bool_]:
        """Whether a value, or each value of an array of any shape, is on the right side of the limit."""
        if self.below:
            return value <= limit if self.closed else value < limit
        return value >= limit if self.closed else value > limit

    def relation(self, passes: bool) -> str:
        """Return the sign between a value that passes, or fails, and the limit."""
        if self.below == passes:
            return "≤" if self.closed == passes else "<"
        return "≥" if self.closed == passes else ">"

    def plane_of(self, evidence: Evidence) -> NDArray[Any]:
        """Return the (rows, cells) plane of the evidence. Raises InputError if it was not measured."""
        if not self.measured(evidence):
            raise InputError(unmeasured_message(self.family))
        return np.asarray(getattr(evidence, self.plane))

    def measure(self, evidence: Evidence, corridor: Part) -> tuple[float, Part]:
        """Return the value, 0 to 1, and the part of the corridor that it comes from. Raises InputError if the evidence
        lacks the plane."""
        rows, cells = corridor
        values = self.plane_of(evidence)[rows, cells]
        full = FULL[self.plane]
        if self.over == "corridor":
            return float(values.mean()) / full, corridor
        if self.over == "row":
            # Equals values.mean(axis=1), which takes twice as long.
            means = np.add.reduce(values, axis=1, dtype=np.float64) / values.shape[1]
            row = int(means.argmax() if self.below else means.argmin())
            return float(means[row]) / full, (slice(row, row + 1), cells)
        row, cell = divmod(int(values.argmax() if self.below else values.argmin()), values.shape[1])
        at = cells.start + cell
        return float(values[row, cell]) / full, (slice(row, row + 1), slice(at, at + 1))


def unmeasured_message(family: str) -> str:
    """Return the message for evidence that lacks the data of a family of criteria."""
    return (
        f"The evidence has no data for the criterion {family!r}, because this was not measured when the "
        "map was built; build the map again with it (`nvsim map --reapply --criteria …`)."
    )
