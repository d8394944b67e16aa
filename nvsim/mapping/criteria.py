"""The criteria of a corridor, in one table, and the decision from stored evidence alone.

`CRITERIA` is the only definition. The builder (`decide`), the decision of a whole graph (`evidence_stack`), the
explanation (`explain`), and the sliders and texts of the window use it. A new criterion is a threshold in
`MappingConfig` and a row here. The criteria of a family apply if the configuration names it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Decision, Evidence
from nvsim.mapping.criterion import FULL, Criterion, Part
from nvsim.mapping.evidence.second_opinions import opinions
from nvsim.mapping.families import NETWORK_NORMAL

if TYPE_CHECKING:
    from nvsim.mapping.config import MappingConfig

OPEN: Decision = "open"
DISPUTED: Decision = "disputed"

CRITERIA: tuple[Criterion, ...] = (
    Criterion("tau_alpha", "alpha", "mean alpha", "Mean alpha below", "alpha", "corridor", True),
    Criterion("row_alpha", "alpha", "worst row's alpha", "Row alpha below", "alpha", "row", True),
    Criterion("cell_alpha", "alpha", "worst cell's alpha", "Cell alpha below", "alpha", "cell", True),
    Criterion("tau_normal", "normal", "mean upward normal", "Mean normal above", "up", "corridor", False),
    Criterion("row_normal", "normal", "lowest row's upward normal", "Row normal above", "up", "row", False),
    Criterion(
        "tau_network_normal",
        NETWORK_NORMAL,
        "mean upward normal of the network",
        "Mean network normal above",
        "network_up",
        "corridor",
        False,
    ),
    Criterion(
        "row_network_normal",
        NETWORK_NORMAL,
        "lowest row's upward normal of the network",
        "Row network normal above",
        "network_up",
        "row",
        False,
    ),
    Criterion("tau_depth", "depth", "mean depth reach", "Mean depth reach above", "reach", "corridor", False),
    Criterion(
        "row_depth",
        "depth",
        "lowest row's depth reach",
        "Row depth reach above",
        "reach",
        "row",
        False,
    ),
    Criterion("tau_slice", "slice", "mean slice", "Mean slice below", "mass", "corridor", True),
    Criterion("row_slice", "slice", "worst row's slice", "Row slice below", "mass", "row", True),
    Criterion("cell_slice", "slice", "worst cell's slice", "Cell slice below", "mass", "cell", True),
    Criterion(
        "support", "unknown", "lowest row's known floor", "Known floor at least", "support", "row", False, closed=True
    ),
)
"""The order in which criteria are tested: the first that fails is the decision (paper Algorithm 1, line 6, tests the
means of alpha and normal)."""


@dataclass(frozen=True)
class DecisionTexts:
    """Texts of a decision: a label for lists, a clause for sentences, and a remedy for users."""

    label: str
    clause: str
    remedy: str


DECISIONS: Mapping[Decision, DecisionTexts] = {
    "alpha": DecisionTexts(
        "blocked",
        "an obstacle is in the corridor",
        "photograph the place from more sides, or raise the alpha limits if it is free",
    ),
    "normal": DecisionTexts(
        "not level",
        "a surface in the corridor does not face up",
        "photograph its floor from above, or lower the limits of the upward normal if it is level",
    ),
    "network-normal": DecisionTexts(
        "not level (network)",
        "according to the network, a surface in the corridor does not face up",
        "check the place in a panorama, or lower the limits of the network's normal if its floor is level",
    ),
    "depth": DecisionTexts(
        "depth ends early",
        "the rendered depth ends before the floor of the corridor",
        "photograph the place from more sides, or lower the depth limits if it is free",
    ),
    "slice": DecisionTexts(
        "Gaussians in the way",
        "Gaussians are between the floor and the camera in the corridor",
        "photograph the place from more sides, or raise the slice limits if it is free",
    ),
    "unknown": DecisionTexts(
        "floor not seen",
        "no image and no LiDAR scan shows floor along the corridor",
        "photograph the floor there, looking down by 20 to 30 degrees from two or three places, or correct its masks",
    ),
    "disputed": DecisionTexts(
        "models disagree",
        "the model of one submap shows the corridor free, but that of another does not",
        "compare the views of both models, or photograph the place where the submaps meet from more sides",
    ),
    "return": DecisionTexts(
        "not free both ways", "the corridor back is not free", "photograph the place in both directions"
    ),
    "distance": DecisionTexts("too far out", "it leads too far from the trajectory", "raise max_distance"),
    "limit": DecisionTexts("limit reached", "the search had reached its limit of viewpoints", "raise max_viewpoints"),
    "merge": DecisionTexts(
        "too close",
        "another viewpoint is near its end, and the path to that viewpoint is not free",
        "lower the merge radius",
    ),
    "spare": DecisionTexts("not needed", "another path is hardly longer", "lower the stretch of settling"),
    "served": DecisionTexts("covered by others", "other viewpoints are near its end", "lower the merge radius"),
    "around": DecisionTexts(
        "possible glass",
        "the trajectory goes around it through a door or on a long detour, and photographs do not show glass panes",
        "walk through it while taking photographs, or add the edge manually if it is free",
    ),
}
"""Reasons why a corridor has no edge: first the decisions of the criteria, then those of the search."""


SPARED: frozenset[Decision] = frozenset({"spare", "served", "around"})
"""Decisions about free corridors whose edge was omitted."""


def unmeasured_families(evidence: Evidence, config: MappingConfig) -> tuple[str, ...]:
    """Return the families that `config` names, but for which `evidence` or its second opinion has no plane."""
    present = [one for one in (evidence, evidence.second) if one is not None]
    asked = [c for c in CRITERIA if c.family and c.chosen(config)]
    return tuple(dict.fromkeys(c.family for c in asked if any(getattr(one, c.plane) is None for one in present)))


def decide(evidence: Evidence, config: MappingConfig) -> Decision:
    """Return OPEN, or the word of the first criterion that fails. Returns DISPUTED if only one of two models calls the
    corridor open.

    Raises InputError if the evidence lacks the data of a criterion.
    """
    return strictest_decision([_decision(one, config) for one in opinions(evidence, config)])


def strictest_decision(decisions: Sequence[Decision]) -> Decision:
    """Return the decision of one or two opinions: an edge needs both."""
    if len(decisions) > 1 and (decisions[0] == OPEN) != (decisions[1] == OPEN):
        return DISPUTED
    return decisions[0]


def _decision(evidence: Evidence, config: MappingConfig) -> Decision:
    corridor = corridor_of(evidence, config)
    for criterion in _criteria_in_use(CRITERIA, config):
        value, _ = criterion.measure(evidence, corridor)
        if not criterion.passes(value, criterion.limit(config)):
            return criterion.word
    return OPEN


@lru_cache(maxsize=16)
def _criteria_in_use(criteria: tuple[Criterion, ...], config: MappingConfig) -> tuple[Criterion, ...]:
    return tuple(criterion for criterion in criteria if criterion.is_used(config))


def can_stand(around: Iterable[Evidence], config: MappingConfig) -> bool:
    """Whether the floor under a viewpoint is free. All measured directions are used: the cells within half the
    corridor's width of the viewpoint, with the rule's limit for the mean of a row. All models that were used must
    agree."""
    several = [opinions(evidence, config) for evidence in around]
    firsts = [one[0] for one in several]
    if not _can_stand(firsts, config):
        return False
    # All directions of a viewpoint were measured with the same models.
    return not any(len(one) > 1 for one in several) or _can_stand([one[-1] for one in several], config)


def _can_stand(around: list[Evidence], config: MappingConfig) -> bool:
    if not around or floor_below(around, config)[1] < config.support:
        return False
    for criterion in standing_criteria(config):
        beneath = np.concatenate(
            [criterion.plane_of(evidence)[cells_under_robot(evidence, config)] for evidence in around]
        )
        if not criterion.passes(float(beneath.mean() / FULL[criterion.plane]), criterion.limit(config)):
            return False
    return True


def standing_criteria(config: MappingConfig) -> tuple[Criterion, ...]:
    """Return the criteria for the mean over the floor under a viewpoint: one of each family, for a row under rule worst
    and otherwise for the corridor. The upward normal contains 1 - alpha, so it adds nothing if alpha is tested."""
    over = "row" if config.rule == "worst" else "corridor"
    families = [f for f in config.criteria if f != "normal" or "alpha" not in config.criteria]
    return tuple(c for c in CRITERIA if c.family in families and c.over == over and c.is_used(config))


def floor_below(around: Iterable[Evidence], config: MappingConfig) -> tuple[float, float]:
    """Return the mean alpha of the floor under a viewpoint, and the known share of this floor, 0 to 1. Returns (1, 0)
    without evidence."""
    alpha, support = [], []
    for evidence in around:
        near = cells_under_robot(evidence, config)
        alpha.append(evidence.alpha[near])
        support.append(evidence.support[near])
    if not alpha:
        return 1.0, 0.0
    return float(np.concatenate(alpha).mean() / 255), float(np.concatenate(support).mean())


def cells_under_robot(evidence: Evidence, config: MappingConfig) -> NDArray[np.bool_]:
    """Return (rows, cells) bool: the cells within half the corridor's width of the viewpoint. A point-like robot has
    the nearest cells."""
    grid = _Grid.of(evidence)
    return _cells_within(grid, max(config.half_width, grid.near + grid.depth))


def is_sufficient(evidence: Evidence, length: float, heading: float, config: MappingConfig) -> bool:
    """Whether stored evidence is sufficient for a corridor of this length (meters) and heading (radians) under
    `config`. Only the first model is checked."""
    turn = abs((evidence.heading - heading + np.pi) % (2 * np.pi) - np.pi)
    return bool(
        abs(evidence.length - length) < 1e-6
        and turn < 1e-6
        and evidence.near + len(evidence.alpha) * evidence.depth >= length + config.half_width - 1e-9
        and evidence.width >= 2 * config.half_width - 1e-9
        and evidence.views == config.views
        and not unmeasured_families(evidence, config)
    )


def corridor_of(evidence: Evidence, config: MappingConfig) -> Part:
    """Return the rows and cells of the corridor that the robot needs. The rows end half the corridor's width beyond the
    step. A point-like robot needs at least one row and one cell."""
    grid = _Grid.of(evidence)
    return _part(grid, evidence.length, config.half_width)


class _Grid(NamedTuple):
    """The cells of evidence, in meters."""

    rows: int
    cells: int
    near: float
    depth: float
    width: float

    @staticmethod
    def of(evidence: Evidence) -> _Grid:
        rows, cells = evidence.alpha.shape
        return _Grid(rows, cells, evidence.near, evidence.depth, evidence.width)


@lru_cache(maxsize=64)
def _cells_within(grid: _Grid, reach: float) -> NDArray[np.bool_]:
    along, across = _centers(grid)
    found = np.asarray(np.hypot(along[:, None], across[None, :]) <= reach)
    found.setflags(write=False)
    return found


@lru_cache(maxsize=1024)
def _part(grid: _Grid, length: float, half_width: float) -> Part:
    along, across = _centers(grid)
    rows = max(1, int((along - grid.depth / 2 < length + half_width - 1e-9).sum()))
    inside = np.flatnonzero(np.abs(across) <= max(half_width, grid.width / grid.cells) + 1e-9)
    return slice(0, rows), slice(int(inside[0]), int(inside[-1]) + 1)


def _centers(grid: _Grid) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(rows,) meters ahead and (cells,) meters to the right of the cell centers."""
    along = grid.near + (np.arange(grid.rows) + 0.5) * grid.depth
    return along, ((np.arange(grid.cells) + 0.5) / grid.cells - 0.5) * grid.width
