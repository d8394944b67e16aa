"""When a capture gives too little of a graph: one sentence that says why, where, and what to photograph or set."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import DECISIONS, SPARED, standing

_FEW = 3  # viewpoints
_MOST_UNCOVERED = 0.3  # share of the trajectory


class NowhereToStand(InputError):
    """A build found no place for a viewpoint: there is no map."""


def too_little(report: Mapping[str, Any], uncovered: NDArray[np.floating], places: int) -> str:
    """The sentence about the graph of a build's `report`, "" for one that is fine. `uncovered` (N, 2 or 3) are those of
    the `places` of the trajectory that have no viewpoint near, metres."""
    few = report["viewpoints"] < _FEW or not report["edges"]
    if not few and len(uncovered) <= _MOST_UNCOVERED * places:
        return ""
    found = f"{_counted(report['viewpoints'], 'viewpoint')} and {_counted(report['edges'], 'edge')}"
    where = ""
    if len(uncovered):
        # The place in the midst of the most of them.
        apart = np.linalg.norm(uncovered[:, None, :2] - uncovered[None, :, :2], axis=2)
        x, y = uncovered[int((apart < 2.0).sum(axis=1).argmax()), :2]
        where = f", and {len(uncovered)} of {places} places of the trajectory have none near, most around "
        where += f"x {x:.1f}, y {y:.1f} m"
    refused = {word: n for word, n in report["decisions"].items() if word in DECISIONS and word not in SPARED}
    if not refused:
        return f"The capture gives only {found}{where}: the cameras cover too little floor; photograph more of it."
    word = max(refused, key=lambda w: (refused[w], w))
    why = f"{refused[word]} of {sum(report['decisions'].values())} directions were refused as {DECISIONS[word].clause}"
    return f"The capture gives only {found}{where}: {why}; {DECISIONS[word].remedy}."


def nowhere_to_stand(refusals: list[tuple[float, float]], config: MappingConfig) -> str:
    """The sentence where there is no viewpoint at all, from the `footing` of all places that were tried."""
    asked = standing(config)
    limit = next((c.limit(config) for c in asked if c.plane == "alpha"), float("inf"))
    blocked = [alpha for alpha, known in refusals if alpha >= limit or known >= config.support]
    tried = f"Nobody can stand anywhere: {_counted(len(refusals), 'place')} on the trajectory and beside it"
    if 2 * len(blocked) < len(refusals) or not refusals:
        return f"{tried} have too little known floor under them; {DECISIONS['unknown'].remedy}."
    filled = [alpha for alpha in blocked if alpha >= limit]
    if not filled:
        words = DECISIONS[asked[-1].word]
        return f"{tried} were tried, of {len(blocked)} known floor, and {words.clause}; {words.remedy}."
    why = f"{len(filled)} have something on the floor (mean alpha {min(filled):.2f} at least, below {limit:g} is free)"
    return f"{tried} were tried and {why}; look at the floor masks and heights there, and {DECISIONS['alpha'].remedy}."


def _counted(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
