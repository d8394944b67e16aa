"""The decision from stored evidence alone: pure functions of the evidence and the thresholds."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Evidence
from nvsim.mapping.config import MappingConfig

OPEN = "open"


def decide(evidence: Evidence, config: MappingConfig) -> str:
    """ "open", or the first criterion that fails: "alpha", "normal" (paper Algorithm 1, line 6), "unknown"."""
    rows, cells = corridor_of(evidence, config)
    # Means of the bytes, so that sums which were kept give the same answer to the last bit.
    alpha, up = evidence.alpha[rows, cells], evidence.up[rows, cells]
    if alpha.mean() / 255 >= config.tau_alpha:
        return "alpha"
    worst = config.rule == "worst"
    if worst and (alpha.mean(axis=1).max() / 255 >= config.row_alpha or alpha.max() / 255 >= config.cell_alpha):
        return "alpha"
    if up.mean() / 255 <= config.tau_normal:
        return "normal"
    if worst and up.mean(axis=1).min() / 255 <= config.row_normal:
        return "normal"
    if evidence.support[rows, cells].mean(axis=1).min() < config.support:
        return "unknown"
    return OPEN


def can_stand(around: Iterable[Evidence], config: MappingConfig) -> bool:
    """Whether the floor under a viewpoint is free: the cells within the robot's radius of it, in every direction that
    was measured, under the rule's limit for the mean of a row."""
    alpha, support = [], []
    for evidence in around:
        near = under(evidence, config)
        alpha.append(evidence.alpha[near])
        support.append(evidence.support[near])
    if not alpha:
        return False
    return bool(
        np.concatenate(alpha).mean() / 255 < standing_limit(config) and np.concatenate(support).mean() >= config.support
    )


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


def corridor_of(evidence: Evidence, config: MappingConfig) -> tuple[slice, slice]:
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
