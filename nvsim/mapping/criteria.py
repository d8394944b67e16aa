"""The criteria of a corridor, in one table, and the decision from stored evidence alone.

Whoever decides or explains reads `CRITERIA`: the builder (`decide`), the stack that decides a whole graph again
(`evidence_stack`), the explanation (`explain`), the sliders and the words of the window. A new criterion is a threshold
in `MappingConfig` and a row here. Those of one family are asked when the configuration names it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Decision, Evidence
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criterion import FULL, Criterion, Part
from nvsim.mapping.families import NETWORK_NORMAL
from nvsim.mapping.opinions import opinions

OPEN: Decision = "open"
DISPUTED: Decision = "disputed"

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
        "least row's upward normal of the network",
        "Row's network normal above",
        "network_up",
        "row",
        False,
        worst_only=True,
    ),
    Criterion("tau_depth", "depth", "mean reach of depth", "Mean reach above", "reach", "corridor", False),
    Criterion(
        "row_depth", "depth", "least row's reach of depth", "Row's reach above", "reach", "row", False, worst_only=True
    ),
    Criterion("tau_slice", "slice", "mean slice", "Mean slice below", "mass", "corridor", True),
    Criterion("row_slice", "slice", "worst row's slice", "Row's slice below", "mass", "row", True, worst_only=True),
    Criterion("cell_slice", "slice", "worst cell's slice", "Cell's slice below", "mass", "cell", True, worst_only=True),
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
    "network-normal": Words(
        "not level by the network",
        "what the network sees in the corridor does not face up",
        "look at the place in a panorama, or lower the limits of the network's normal where its floor is level",
    ),
    "depth": Words(
        "depth ends early",
        "the rendered depth ends before the floor of the corridor",
        "photograph the place from more sides, or lower the limits of depth where it is free",
    ),
    "slice": Words(
        "Gaussians in it",
        "Gaussians stand between the floor and the camera in the corridor",
        "photograph the place from more sides, or raise the limits of the slice where it is free",
    ),
    "unknown": Words(
        "floor not seen",
        "no image and no scan shows floor along the corridor",
        "photograph the floor there, looking down by 20 to 30 degrees from two or three places, or correct its masks",
    ),
    "disputed": Words(
        "models disagree",
        "one submap's model shows the corridor free and another's does not",
        "look at it from both models, or photograph the place where the submaps meet from more sides",
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
    "around": Words(
        "walked around",
        "the trajectory leads far around, and photographs alone do not show a pane of glass",
        "walk there while photographing, or add the edge by hand where it is free",
    ),
}
"""Why no edge came of a corridor: the criteria's decisions, then those of the search."""


SPARED: frozenset[Decision] = frozenset({"spare", "served", "around"})
"""Of these: the corridor is free, and the edge was left out all the same."""


def lacking(evidence: Evidence, config: MappingConfig) -> tuple[str, ...]:
    """The families that `config` names and `evidence`, or the second opinion in it, holds no plane of."""
    told = [one for one in (evidence, evidence.second) if one is not None]
    asked = [c for c in CRITERIA if c.family and c.chosen(config)]
    return tuple(dict.fromkeys(c.family for c in asked if any(getattr(one, c.plane) is None for one in told)))


def decide(evidence: Evidence, config: MappingConfig) -> Decision:
    """OPEN, or the word of the first criterion that fails; DISPUTED where one of two models calls the corridor open.

    Raises InputError where the evidence lacks what a criterion asks for.
    """
    return stricter([_decision(one, config) for one in opinions(evidence, config)])


def stricter(decisions: Sequence[Decision]) -> Decision:
    """The decision of one or two opinions: an edge needs both."""
    if len(decisions) > 1 and (decisions[0] == OPEN) != (decisions[1] == OPEN):
        return DISPUTED
    return decisions[0]


def _decision(evidence: Evidence, config: MappingConfig) -> Decision:
    corridor = corridor_of(evidence, config)
    for criterion in _asked(CRITERIA, config):
        value, _ = criterion.measure(evidence, corridor)
        if not criterion.passes(value, criterion.limit(config)):
            return criterion.word
    return OPEN


@lru_cache(maxsize=16)
def _asked(criteria: tuple[Criterion, ...], config: MappingConfig) -> tuple[Criterion, ...]:
    return tuple(criterion for criterion in criteria if criterion.asked(config))


def can_stand(around: Iterable[Evidence], config: MappingConfig) -> bool:
    """Whether the floor under a viewpoint is free: the cells within the robot's radius of it, in every direction that
    was measured, under the rule's limit for the mean of a row; in every model that was asked."""
    several = [opinions(evidence, config) for evidence in around]
    firsts = [one[0] for one in several]
    if not _stands(firsts, config):
        return False
    # All directions of a viewpoint were measured with the same models.
    return not any(len(one) > 1 for one in several) or _stands([one[-1] for one in several], config)


def _stands(around: list[Evidence], config: MappingConfig) -> bool:
    if not around or footing(around, config)[1] < config.support:
        return False
    for criterion in standing(config):
        beneath = np.concatenate([criterion.plane_of(evidence)[under(evidence, config)] for evidence in around])
        if not criterion.passes(float(beneath.mean() / FULL[criterion.plane]), criterion.limit(config)):
            return False
    return True


def standing(config: MappingConfig) -> tuple[Criterion, ...]:
    """What the mean over the floor under a viewpoint is held against: the rule's criterion of a row of each family. The
    upward normal contains 1 - alpha, so beside alpha it says nothing more of a floor."""
    over = "row" if config.rule == "worst" else "corridor"
    families = [f for f in config.criteria if f != "normal" or "alpha" not in config.criteria]
    return tuple(c for c in CRITERIA if c.family in families and c.over == over)


def footing(around: Iterable[Evidence], config: MappingConfig) -> tuple[float, float]:
    """Of the floor under a viewpoint: its mean alpha, and how much of it is known, 0 to 1; (1, 0) where nothing was
    measured."""
    alpha, support = [], []
    for evidence in around:
        near = under(evidence, config)
        alpha.append(evidence.alpha[near])
        support.append(evidence.support[near])
    if not alpha:
        return 1.0, 0.0
    return float(np.concatenate(alpha).mean() / 255), float(np.concatenate(support).mean())


def under(evidence: Evidence, config: MappingConfig) -> NDArray[np.bool_]:
    """(rows, cells) the cells within the robot's radius of the viewpoint; a point-like robot stands on the first ones
    as well."""
    grid = _Grid.of(evidence)
    return _under(grid, max(config.half_width, grid.near + grid.depth))


def answers(evidence: Evidence, length: float, heading: float, config: MappingConfig) -> bool:
    """Whether stored evidence holds what a corridor of this length and heading needs under `config`, of the first model
    that is asked."""
    turn = abs((evidence.heading - heading + np.pi) % (2 * np.pi) - np.pi)
    return bool(
        abs(evidence.length - length) < 1e-6
        and turn < 1e-6
        and evidence.near + len(evidence.alpha) * evidence.depth >= length + config.half_width - 1e-9
        and evidence.width >= 2 * config.half_width - 1e-9
        and evidence.views == config.views
        and not lacking(evidence, config)
    )


def corridor_of(evidence: Evidence, config: MappingConfig) -> Part:
    """The rows up to the end of the step and the robot's radius beyond, the cells within its radius of the middle; at
    least one of each, so that a point-like robot has a corridor as well."""
    grid = _Grid.of(evidence)
    return _part(grid, evidence.length, config.half_width)


class _Grid(NamedTuple):
    """The cells of evidence; metres."""

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
def _under(grid: _Grid, reach: float) -> NDArray[np.bool_]:
    along, across = _centres(grid)
    found = np.asarray(np.hypot(along[:, None], across[None, :]) <= reach)
    found.setflags(write=False)
    return found


@lru_cache(maxsize=1024)
def _part(grid: _Grid, length: float, half_width: float) -> Part:
    along, across = _centres(grid)
    rows = max(1, int((along - grid.depth / 2 < length + half_width - 1e-9).sum()))
    inside = np.flatnonzero(np.abs(across) <= max(half_width, grid.width / grid.cells) + 1e-9)
    return slice(0, rows), slice(int(inside[0]), int(inside[-1]) + 1)


def _centres(grid: _Grid) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(rows,) metres ahead and (cells,) metres to the right of the cell centres."""
    along = grid.near + (np.arange(grid.rows) + 0.5) * grid.depth
    return along, ((np.arange(grid.cells) + 0.5) / grid.cells - 0.5) * grid.width
