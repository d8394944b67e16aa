"""Why a corridor is open or not: every measured value beside its limit, and the part of the corridor it comes from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Evidence
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import OPEN, corridor_of
from nvsim.mapping.evidence_stack import WORDS

Part = tuple[slice, slice]  # rows and cells of the corridor


@dataclass(frozen=True)
class Measure:
    """One value against one threshold.

    field    the threshold's name in MappingConfig
    name     what is measured, in words
    word     the decision when it fails
    below    whether the value must stay below the limit; else it must exceed it
    decides  False for a value that the rule "mean" does not ask about
    part     where in the corridor the value was found
    """

    field: str
    name: str
    word: str
    value: float
    limit: float
    below: bool
    decides: bool
    part: Part

    @property
    def passes(self) -> bool:
        if self.below:
            return self.value < self.limit
        return self.value >= self.limit if self.field == "support" else self.value > self.limit


@dataclass(frozen=True)
class Explanation:
    """decision  "open", or the first criterion that fails: "alpha", "normal", "unknown"
    measures  in the order in which they are asked
    corridor  the rows and cells that the robot needs
    obstacle  metres to the first row that something stands in, None where nothing does
    """

    decision: str
    measures: tuple[Measure, ...]
    corridor: Part
    obstacle: float | None

    @property
    def failed(self) -> Measure | None:
        """What decided; None for an open corridor."""
        return next((m for m in self.measures if m.decides and not m.passes), None)

    @property
    def tightest(self) -> Measure:
        """Of what the rule asks about, what is nearest to its limit."""
        return min((m for m in self.measures if m.decides), key=lambda m: abs(m.limit - m.value))


def explain(evidence: Evidence, config: MappingConfig) -> Explanation:
    """The decision of `criteria.decide`, with its reasons."""
    rows, cells = corridor_of(evidence, config)
    alpha, up = evidence.alpha[rows, cells], evidence.up[rows, cells]
    worst = config.rule == "worst"
    row = alpha.mean(axis=1) / 255
    fullest = int(row.argmax())
    cell = np.unravel_index(int(alpha.argmax()), alpha.shape)
    normal = up.mean(axis=1) / 255
    steepest = int(normal.argmin())
    known = evidence.support[rows, cells].mean(axis=1)
    barest = int(known.argmin())
    whole = (rows, cells)

    def one(r: int) -> Part:
        return slice(r, r + 1), cells

    at = (slice(int(cell[0]), int(cell[0]) + 1), slice(cells.start + int(cell[1]), cells.start + int(cell[1]) + 1))

    def measure(field: str, name: str, value: float, below: bool, decides: bool, part: Part) -> Measure:
        word = "unknown" if field == "support" else field.split("_")[1]
        return Measure(field, name, word, float(value), float(getattr(config, field)), below, decides, part)

    measures = (
        measure("tau_alpha", "mean alpha", alpha.mean() / 255, True, True, whole),
        measure("row_alpha", "worst row's alpha", row[fullest], True, worst, one(fullest)),
        measure("cell_alpha", "worst cell's alpha", alpha.max() / 255, True, worst, at),
        measure("tau_normal", "mean upward normal", up.mean() / 255, False, True, whole),
        measure("row_normal", "least row's upward normal", normal[steepest], False, worst, one(steepest)),
        measure("support", "least row's known floor", known[barest], False, True, one(barest)),
    )
    failed = next((m for m in measures if m.decides and not m.passes), None)
    word = OPEN if failed is None else failed.word
    assert word in WORDS
    return Explanation(word, measures, whole, _obstacle(evidence, alpha, config))


def _obstacle(evidence: Evidence, alpha: NDArray[np.uint8], config: MappingConfig) -> float | None:
    """Where the first row lies that the rule, or one that asks for a half, takes as filled."""
    row, cell = (config.row_alpha, config.cell_alpha) if config.rule == "worst" else (0.5, 0.95)
    filled = np.flatnonzero((alpha.mean(axis=1) / 255 >= row) | (alpha.max(axis=1) / 255 >= cell))
    return None if len(filled) == 0 else evidence.near + float(filled[0]) * evidence.depth


def outline(evidence: Evidence, part: Part) -> NDArray[np.float64]:
    """(4, 2) world x, y of the corners of a part of the corridor: near left, far left, far right, near right."""
    rows, cells = part
    each = evidence.width / evidence.alpha.shape[1]
    along = np.array([rows.start, rows.stop]) * evidence.depth + evidence.near
    across = np.array([cells.start, cells.stop]) * each - evidence.width / 2
    forward = np.array([np.sin(evidence.heading), np.cos(evidence.heading)])
    right = np.array([forward[1], -forward[0]])
    start = np.array(evidence.target) - evidence.length * forward
    corners = ((along[0], across[0]), (along[1], across[0]), (along[1], across[1]), (along[0], across[1]))
    return np.array([start + a * forward + b * right for a, b in corners])
