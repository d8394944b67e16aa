"""Explain why a capture gives a poor graph, or why parts of a graph are disconnected: the reason,
the place, and a remedy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.types import Decision, Viewpoint
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import SupportAt
from nvsim.mapping.criteria import DECISIONS, OPEN, SPARED, standing_criteria
from nvsim.mapping.search.survey import Survey
from nvsim.plain_text import count_text

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
    found = f"{count_text(report['viewpoints'], 'viewpoint')} and {count_text(report['edges'], 'edge')}"
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
    """Return the sentence for a build without any viewpoint, from the `floor_below` of all tried positions."""
    asked = standing_criteria(config)
    limit = next((c.limit(config) for c in asked if c.plane == "alpha"), float("inf"))
    blocked = [alpha for alpha, known in refusals if alpha >= limit or known >= config.support]
    count = count_text(len(refusals), "position")
    tried = f"No position has room for a viewpoint: {count} on the trajectory and beside it"
    if 2 * len(blocked) < len(refusals) or not refusals:
        return f"{tried} have too little known floor under them; {DECISIONS['unknown'].remedy}."
    filled = [alpha for alpha in blocked if alpha >= limit]
    if not filled:
        words = DECISIONS[asked[-1].word]
        return f"{tried} were tried, {len(blocked)} with known floor, but {words.clause}; {words.remedy}."
    why = f"{len(filled)} have an obstacle on the floor (mean alpha at least {min(filled):.2f}, free below {limit:g})"
    return f"{tried} were tried and {why}; check the floor masks and heights there, and {DECISIONS['alpha'].remedy}."


_MOST = 2  # maximum parts that are explained
_UPRIGHT = 3.0  # weight of a vertical meter, relative to a horizontal one
_LOOKED = 0.02  # meters between the floor positions that are examined


def explain_disconnected_parts(groups: list[list[str]], survey: Survey, support: SupportAt) -> str:
    """Return a sentence about each of the largest parts except the first; "" for one part. `groups` are ids, the
    largest group first. The path between a part and the nearest other part is examined if it is short enough for an
    edge. Viewpoints of users are ignored, because the survey does not contain them."""
    known = ([id for id in group if id in survey.draft.viewpoints] for group in groups)
    groups = [group for group in known if group]
    return " ".join(_reason_for_group(group, groups, survey, support) for group in groups[1 : 1 + _MOST])


def _reason_for_group(group: list[str], groups: list[list[str]], survey: Survey, support: SupportAt) -> str:
    here, there = _nearest(group, [id for other in groups if other is not group for id in other], survey)
    meters = math.dist(here.position[:2], there.position[:2])
    which = f"The part of {len(group)}" if len(group) > 1 else "The single viewpoint"
    places = f"{_place_text(here.position)}, {meters:.1f} m from {_place_text(there.position)}"
    begin = f"{which} is nearest to another part at {places}"
    if meters > survey.config.reach:
        return f"{begin}, which is too far for an edge: photograph the area between them."
    decision = _decision(here, there, survey)
    if decision == OPEN:
        return f"{begin}, and the path between them is free; add the edge manually."
    words, where = DECISIONS[decision], ""
    if decision == "unknown":
        where = f" around {_place_text(_unknown_floor_center(here, there, survey, support))}"
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
        left_out = survey.decision_between(a, b)
        decision = left_out if left_out in SPARED else survey.decide_corridor(a, b)
        if decision != OPEN:
            return decision
    return OPEN


def _unknown_floor_center(here: Viewpoint, there: Viewpoint, survey: Survey, support: SupportAt) -> NDArray[np.float64]:
    """(2,) world x, y in meters of the center of the unknown floor of the corridor."""
    a, b = np.array(here.position), np.array(there.position)
    along = (b - a) / max(math.dist(a[:2], b[:2]), 1e-9)
    aside = np.array([-along[1], along[0], 0.0])
    half = survey.config.half_width
    lengths, widths = (np.arange(0.0, most, _LOOKED) for most in (math.dist(a[:2], b[:2]), 2 * half + _LOOKED))
    places = a + lengths[:, None, None] * along + (widths[None, :, None] - half) * aside
    unknown = ~np.asarray(support(places), bool)
    return np.asarray(places[unknown].mean(axis=0)[:2] if unknown.any() else (a + b)[:2] / 2)


def _place_text(place: NDArray[np.floating] | tuple[float, ...]) -> str:
    return f"x {place[0]:.1f}, y {place[1]:.1f} m"
