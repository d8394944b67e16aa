"""The criteria of a corridor, in one table, and the decision from stored evidence alone.

Whoever decides or explains reads `CRITERIA`: the builder (`decide`), the stack that decides a whole graph again
(`evidence_stack`), the explanation (`explain`), the sliders and the words of the window. A new criterion is a threshold
in `MappingConfig` and a row here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Decision, Evidence
from nvsim.mapping.config import MappingConfig

OPEN: Decision = "open"
Plane = Literal["alpha", "up", "support"]
Part = tuple[slice, slice]  # rows and cells of the corridor
FULL: Mapping[Plane, int] = {"alpha": 255, "up": 255, "support": 1}
"""What a stored value of 1 is in each plane of the evidence."""


@dataclass(frozen=True)
class Criterion:
    """One measured value against one threshold.

    field       the threshold's name in MappingConfig
    word        the decision when it fails
    name        what is measured, in words
    label       the same beside a slider
    plane       the plane of the evidence that it looks at
    over        "corridor" takes the mean of all cells, "row" the worst mean of a row, "cell" the worst cell
    below       whether the value must stay below the limit; else it must exceed it
    closed      whether a value at the limit passes
    worst_only  whether only the rule "worst" asks for it
    """

    field: str
    word: Decision
    name: str
    label: str
    plane: Plane
    over: Literal["corridor", "row", "cell"]
    below: bool
    closed: bool = False
    worst_only: bool = False

    def limit(self, config: MappingConfig) -> float:
        return float(getattr(config, self.field))

    def asked(self, config: MappingConfig) -> bool:
        return not self.worst_only or config.rule == "worst"

    @overload
    def passes(self, value: float, limit: float) -> bool: ...
    @overload
    def passes(self, value: NDArray[np.floating], limit: float) -> NDArray[np.bool_]: ...
    def passes(self, value: float | NDArray[np.floating], limit: float) -> bool | NDArray[np.bool_]:
        """Whether a value, or each value of an array, is on the right side of the limit."""
        if self.below:
            return value <= limit if self.closed else value < limit
        return value >= limit if self.closed else value > limit

    def relation(self, passes: bool) -> str:
        """How a value that passes, or fails, lies to the limit."""
        if self.below == passes:
            return "≤" if self.closed == passes else "<"
        return "≥" if self.closed == passes else ">"

    def measure(self, evidence: Evidence, corridor: Part) -> tuple[float, Part]:
        """The value, 0 to 1, and the part of the corridor that it comes from."""
        rows, cells = corridor
        values: NDArray[Any] = getattr(evidence, self.plane)[rows, cells]
        full = FULL[self.plane]
        if self.over == "corridor":
            return float(values.mean()) / full, corridor
        if self.over == "row":
            means = values.mean(axis=1)
            row = int(means.argmax() if self.below else means.argmin())
            return float(means[row]) / full, (slice(row, row + 1), cells)
        row, cell = divmod(int(values.argmax() if self.below else values.argmin()), values.shape[1])
        at = cells.start + cell
        return float(values[row, cell]) / full, (slice(row, row + 1), slice(at, at + 1))


CRITERIA: tuple[Criterion, ...] = (
    Criterion("tau_alpha", "alpha", "mean alpha", "Mean alpha below", "alpha", "corridor", True),
    Criterion("row_alpha", "alpha", "worst row's alpha", "Row's alpha below", "alpha", "row", True, worst_only=True),
    Criterion(
        "cell_alpha", "alpha", "worst cell's alpha", "Cell's alpha below", "alpha", "cell", True, worst_only=True
    ),
    Criterion("tau_normal", "normal", "mean upward normal", "Mean normal above", "up", "corridor", False),
    Criterion(
        "row_normal", "normal", "least row's upward normal", "Row's normal above", "up", "row", False, worst_only=True
    ),
    Criterion(
        "support", "unknown", "least row's known floor", "Known floor, least", "support", "row", False, closed=True
    ),
)
"""In the order in which they are asked: the first that fails is the decision (paper Algorithm 1, line 6, asks for the
means of alpha and normal)."""


@dataclass(frozen=True)
class Words:
    """label for a list, clause for a sentence, and what a user can do about it."""

    label: str
    clause: str
    remedy: str


DECISIONS: Mapping[Decision, Words] = {
    "alpha": Words(
        "blocked",
        "something stands in the corridor",
        "photograph the place from more sides, or raise the limits of alpha where it is free",
    ),
    "normal": Words(
        "not level",
        "what lies in the corridor does not face up",
        "photograph its floor from above, or lower the limits of the upward normal where it is level",
    ),
    "unknown": Words(
        "floor not seen",
        "no image and no scan shows floor along the corridor",
        "photograph the floor there, looking down by 20 to 30 degrees from two or three places, or correct its masks",
    ),
    "return": Words("no way back", "the way there is free, the way back is not", "photograph the place both ways"),
    "distance": Words("too far out", "it leads too far from the trajectory", "raise the greatest distance from it"),
    "limit": Words("limit reached", "the search had reached its limit of viewpoints", "raise max_viewpoints"),
    "merge": Words(
        "too near",
        "another viewpoint stands near its end and the way to it is not free",
        "lower the distance within which viewpoints are one",
    ),
    "spare": Words("not needed", "another way there is hardly longer", "lower the stretch of settling"),
    "served": Words(
        "served", "other viewpoints stand near its end", "lower the distance within which viewpoints are one"
    ),
}
"""Why no edge came of a corridor: the criteria's decisions, then those of the search."""


def decide(evidence: Evidence, config: MappingConfig) -> Decision:
    """OPEN, or the word of the first criterion that fails."""
    corridor = corridor_of(evidence, config)
    for criterion in CRITERIA:
        if criterion.asked(config):
            value, _ = criterion.measure(evidence, corridor)
            if not criterion.passes(value, criterion.limit(config)):
                return criterion.word
    return OPEN


def can_stand(around: Iterable[Evidence], config: MappingConfig) -> bool:
    """Whether the floor under a viewpoint is free: the cells within the robot's radius of it, in every direction that
    was measured, under the rule's limit for the mean of a row."""
    alpha, known = footing(around, config)
    return alpha < standing_limit(config) and known >= config.support


def footing(around: Iterable[Evidence], config: MappingConfig) -> tuple[float, float]:
    """What `can_stand` asks of the floor under a viewpoint: its mean alpha, and how much of it is known, 0 to 1; (1, 0)
    where nothing was measured."""
    alpha, support = [], []
    for evidence in around:
        near = under(evidence, config)
        alpha.append(evidence.alpha[near])
        support.append(evidence.support[near])
    if not alpha:
        return 1.0, 0.0
    return float(np.concatenate(alpha).mean() / 255), float(np.concatenate(support).mean())


def standing_limit(config: MappingConfig) -> float:
    """What the mean alpha of the floor under a viewpoint must stay below."""
    return config.row_alpha if config.rule == "worst" else config.tau_alpha


def under(evidence: Evidence, config: MappingConfig) -> NDArray[np.bool_]:
    """(rows, cells) the cells within the robot's radius of the viewpoint; a point-like robot stands on the first ones
    as well."""
    along, across = _centres(evidence)
    reach = max(config.half_width, evidence.near + evidence.depth)
    return np.asarray(np.hypot(along[:, None], across[None, :]) <= reach)


def answers(evidence: Evidence, length: float, heading: float, config: MappingConfig) -> bool:
    """Whether stored evidence holds what a corridor of this length and heading needs under `config`."""
    turn = abs((evidence.heading - heading + np.pi) % (2 * np.pi) - np.pi)
    return bool(
        abs(evidence.length - length) < 1e-6
        and turn < 1e-6
        and evidence.near + len(evidence.alpha) * evidence.depth >= length + config.half_width - 1e-9
        and evidence.width >= 2 * config.half_width - 1e-9
    )


def corridor_of(evidence: Evidence, config: MappingConfig) -> Part:
    """The rows up to the end of the step and the robot's radius beyond, the cells within its radius of the middle; at
    least one of each, so that a point-like robot has a corridor as well."""
    along, across = _centres(evidence)
    rows = max(1, int((along - evidence.depth / 2 < evidence.length + config.half_width - 1e-9).sum()))
    inside = np.flatnonzero(np.abs(across) <= max(config.half_width, evidence.width / evidence.alpha.shape[1]) + 1e-9)
    return slice(0, rows), slice(int(inside[0]), int(inside[-1]) + 1)


def _centres(evidence: Evidence) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(rows,) metres ahead and (cells,) metres to the right of the cell centres."""
    rows, cells = evidence.alpha.shape
    along = evidence.near + (np.arange(rows) + 0.5) * evidence.depth
    return along, ((np.arange(cells) + 0.5) / cells - 0.5) * evidence.width
