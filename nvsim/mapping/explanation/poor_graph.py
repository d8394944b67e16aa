"""Explain why a capture gives a poor graph, in one sentence: the reason, the place, and a remedy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import DECISIONS, SPARED, standing

_FEW = 3  # viewpoints
_MOST_UNCOVERED = 0.3  # maximum share of the trajectory without a viewpoint nearby


class NoViewpointFound(InputError):
    """A build found no position for a viewpoint, so there is no map."""


def explain_small_graph(report: Mapping[str, Any], uncovered: NDArray[np.floating], places: int) -> str:
    """Return the sentence about a poor graph, "" for a good one. `report` is that of the build. `uncovered` (N, 2) or
    (N, 3), meters, are those of the `places` positions of the trajectory that have no viewpoint nearby."""
    few = report["viewpoints"] < _FEW or not report["edges"]
    if not few and len(uncovered) <= _MOST_UNCOVERED * places:
        return ""
    found = f"{_counted(report['viewpoints'], 'viewpoint')} and {_counted(report['edges'], 'edge')}"
    where = ""
    if len(uncovered):
        # The position with the most of them around it.
        apart = np.linalg.norm(uncovered[:, None, :2] - uncovered[None, :, :2], axis=2)
        x, y = uncovered[int((apart < 2.0).sum(axis=1).argmax()), :2]
        where = f", and {len(uncovered)} of {places} positions of the trajectory have none nearby, most around "
        where += f"x {x:.1f}, y {y:.1f} m"
    refused = {word: n for word, n in report["decisions"].items() if word in DECISIONS and word not in SPARED}
    if not refused:
        return f"The capture gives only {found}{where}: the cameras cover too little floor; photograph more of it."
    word = max(refused, key=lambda w: (refused[w], w))
    why = f"{refused[word]} of {sum(report['decisions'].values())} directions fail because {DECISIONS[word].clause}"
    return f"The capture gives only {found}{where}: {why}; {DECISIONS[word].remedy}."


def explain_no_viewpoint(refusals: list[tuple[float, float]], config: MappingConfig) -> str:
    """Return the sentence for a build without any viewpoint, from the `footing` of all positions that were tried."""
    asked = standing(config)
    limit = next((c.limit(config) for c in asked if c.plane == "alpha"), float("inf"))
    blocked = [alpha for alpha, known in refusals if alpha >= limit or known >= config.support]
    tried = (
        f"No position has room for a viewpoint: {_counted(len(refusals), 'position')} on the trajectory and beside it"
    )
    if 2 * len(blocked) < len(refusals) or not refusals:
        return f"{tried} have too little known floor under them; {DECISIONS['unknown'].remedy}."
    filled = [alpha for alpha in blocked if alpha >= limit]
    if not filled:
        words = DECISIONS[asked[-1].word]
        return f"{tried} were tried, {len(blocked)} with known floor, but {words.clause}; {words.remedy}."
    why = f"{len(filled)} have an obstacle on the floor (mean alpha at least {min(filled):.2f}, free below {limit:g})"
    return f"{tried} were tried and {why}; check the floor masks and heights there, and {DECISIONS['alpha'].remedy}."


def _counted(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
