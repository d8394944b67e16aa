"""Explain why parts of a graph are disconnected: where two parts are nearest, the obstacle there, and the remedy."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Decision, Viewpoint
from nvsim.mapping.corridor import SupportAt
from nvsim.mapping.criteria import DECISIONS, OPEN, SPARED
from nvsim.mapping.survey import Survey

_MOST = 2  # maximum parts that are explained
_UPRIGHT = 3.0  # weight of a vertical meter, relative to a horizontal one
_LOOKED = 0.02  # meters between the floor positions that are examined


def explain_disconnected_parts(groups: list[list[str]], survey: Survey, support: SupportAt) -> str:
    """Return a sentence about each of the largest parts except the first; "" for one part. `groups` are ids, the
    largest group first. The path between a part and the nearest other part is examined if it is short enough for an
    edge. Viewpoints of users are ignored, because the survey does not contain them."""
    known = ([id for id in group if id in survey.draft.viewpoints] for group in groups)
    groups = [group for group in known if group]
    return " ".join(_why(group, groups, survey, support) for group in groups[1 : 1 + _MOST])


def _why(group: list[str], groups: list[list[str]], survey: Survey, support: SupportAt) -> str:
    here, there = _nearest(group, [id for other in groups if other is not group for id in other], survey)
    metres = math.dist(here.position[:2], there.position[:2])
    which = f"The part of {len(group)}" if len(group) > 1 else "The single viewpoint"
    begin = f"{which} is nearest to another part at {_at(here.position)}, {metres:.1f} m from {_at(there.position)}"
    if metres > survey.config.reach:
        return f"{begin}, which is too far for an edge: photograph the area between them."
    decision = _decision(here, there, survey)
    if decision == OPEN:
        return f"{begin}, and the path between them is free; add the edge manually."
    words, where = DECISIONS[decision], ""
    if decision == "unknown":
        where = f" around {_at(_unknown(here, there, survey, support))}"
    free = "the path is free, but " if decision in SPARED else ""
    return f"{begin}: {free}{words.clause}{where}; {words.remedy}."


def _nearest(group: list[str], others: list[str], survey: Survey) -> tuple[Viewpoint, Viewpoint]:
    from scipy.spatial import cKDTree

    places = [survey.draft.viewpoints[id].position * np.array([1, 1, _UPRIGHT]) for id in others]
    own = [survey.draft.viewpoints[id].position * np.array([1, 1, _UPRIGHT]) for id in group]
    apart, nearest = cKDTree(places).query(own)
    at = int(np.argmin(apart))
    return survey.draft.viewpoints[group[at]], survey.draft.viewpoints[others[nearest[at]]]


def _decision(here: Viewpoint, there: Viewpoint, survey: Survey) -> Decision:
    """Return the first decision against an edge, in either direction, or the reason why the edge was omitted."""
    for a, b in ((here, there), (there, here)):
        left_out = survey.left_out(a, b)
        decision = left_out if left_out in SPARED else survey.way(a, b)
        if decision != OPEN:
            return decision
    return OPEN


def _unknown(here: Viewpoint, there: Viewpoint, survey: Survey, support: SupportAt) -> NDArray[np.float64]:
    """(2,) world x, y in meters of the center of the unknown floor of the corridor."""
    a, b = np.array(here.position), np.array(there.position)
    along = (b - a) / max(math.dist(a[:2], b[:2]), 1e-9)
    aside = np.array([-along[1], along[0], 0.0])
    half = survey.config.half_width
    lengths, widths = (np.arange(0.0, most, _LOOKED) for most in (math.dist(a[:2], b[:2]), 2 * half + _LOOKED))
    places = a + lengths[:, None, None] * along + (widths[None, :, None] - half) * aside
    unknown = ~np.asarray(support(places), bool)
    return np.asarray(places[unknown].mean(axis=0)[:2] if unknown.any() else (a + b)[:2] / 2)


def _at(place: NDArray[np.floating] | tuple[float, ...]) -> str:
    return f"x {place[0]:.1f}, y {place[1]:.1f} m"
