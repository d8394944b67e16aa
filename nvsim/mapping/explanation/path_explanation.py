"""Explain why two viewpoints have an edge or not: the distance, the evidence of both directions with the result of
every criterion, the map, and one sentence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nvsim.graph.quantities import evidence_along
from nvsim.graph.types import Decision, Evidence, NavGraph, edge
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import DECISIONS, OPEN, SPARED, unmeasured_families
from nvsim.mapping.explanation.explain import Explanation, combined_corridor, explain
from nvsim.occupancy.types import FREE, OCCUPIED, OccupancyMap

Source = Literal["measured", "others", ""]
_COVERED = 0.5  # share of a corridor; if others cover less of it, they do not support an edge


@dataclass(frozen=True)
class DirectionExplanation:
    """One direction between two viewpoints.

    start, end   ids
    source       "measured" along it, "others": read from corridors that overlap it, "" if nothing is known
    covered      0 to 1, the share of it that other corridors cover; 1 if it was measured
    found        the result of every criterion; None if nothing is known
    refusal      why the search made no edge of it although it was measured; "" if it made one or did not decide
    """

    start: str
    end: str
    source: Source = ""
    covered: float = 0.0
    found: Explanation | None = None
    refusal: Decision = ""


@dataclass(frozen=True)
class PathExplanation:
    """All that is known about the path between two viewpoints.

    joined    whether there is an edge
    meters    meters between the cameras
    rise      meters by which the floor rises from the first to the second
    ways      from the first to the second and back
    blocked   meters along the straight line to the first occupied cell of the map, None if there is none
    unknown   0 to 1, the share of the line that is not free on the map; None without a map
    sentence  the fact that decides
    """

    joined: bool
    meters: float
    rise: float
    ways: tuple[DirectionExplanation, DirectionExplanation]
    blocked: float | None
    unknown: float | None
    sentence: str

    @property
    def support_of_edge(self) -> int:
        """1 if the known facts support an edge, -1 if they contradict it, 0 if nothing is known."""
        found = [way for way in self.ways if way.found is not None]
        if self.blocked is not None or any(w.found is not None and w.found.decision != OPEN for w in found):
            return -1
        sure = any(way.covered >= _COVERED for way in found) or self.unknown == 0.0
        return 1 if sure else 0


def explain_path(
    graph: NavGraph, a: str, b: str, config: MappingConfig, occupancy: OccupancyMap | None = None
) -> PathExplanation:
    """Return all that is known about the path between two different viewpoints of the graph. `occupancy` covers one
    floor."""
    first, second = graph.viewpoints[a], graph.viewpoints[b]
    joined = edge(a, b).key in graph.edges
    ways = _explain_direction(graph, a, b, config), _explain_direction(graph, b, a, config)
    blocked, unknown = _on_map(occupancy, first.position, second.position)
    rise = (second.position[2] - second.height) - (first.position[2] - first.height)
    meters = math.dist(first.position, second.position)
    sentence = _sentence(joined, ways, blocked, unknown, meters)
    return PathExplanation(joined, meters, rise, ways, blocked, unknown, sentence)


def _explain_direction(graph: NavGraph, here: str, there: str, config: MappingConfig) -> DirectionExplanation:
    measured = [
        e for e in evidence_along(graph, (here, there)) if e.viewpoint == here and not unmeasured_families(e, config)
    ]
    if measured:
        found = [explain(e, config) for e in measured]
        worst = min(range(len(found)), key=lambda i: found[i].decision == OPEN)
        return DirectionExplanation(here, there, "measured", 1.0, found[worst], _refusal(measured[worst]))
    laid = combined_corridor(graph, here, there)
    if laid is None or unmeasured_families(laid[0], config):
        return DirectionExplanation(here, there)
    return DirectionExplanation(here, there, "others", laid[1], explain(laid[0], config))


def _refusal(evidence: Evidence) -> Decision:
    return "" if evidence.decision == OPEN else evidence.decision


def _on_map(
    occupancy: OccupancyMap | None, a: tuple[float, float, float], b: tuple[float, float, float]
) -> tuple[float | None, float | None]:
    if occupancy is None:
        return None, None
    length = math.dist(a[:2], b[:2])
    share = np.linspace(0.0, 1.0, max(2, math.ceil(2 * length / occupancy.resolution) + 1))
    cells = occupancy.states_at(np.array(a[:2]) + share[:, None] * (np.array(b[:2]) - a[:2]))
    stops = np.flatnonzero(cells == OCCUPIED)
    return float(share[stops[0]]) * length if len(stops) else None, float((cells != FREE).mean())


def _sentence(
    joined: bool,
    ways: tuple[DirectionExplanation, DirectionExplanation],
    blocked: float | None,
    unknown: float | None,
    meters: float,
) -> str:
    begin = "There is an edge" if joined else "There is no edge"
    against = next((w for w in ways if w.found is not None and w.found.decision != OPEN), None)
    if against is not None and against.found is not None:
        failed, where = against.found.failed, f"seen from {against.start}"
        figures = "" if failed is None else f" ({failed.name} {failed.value:.2f}, limit {failed.limit:.2f})"
        clause = DECISIONS[against.found.decision].clause
        doubt = "although" if joined else "because"
        source = "" if against.source == "measured" else ", according to overlapping corridors"
        return f"{begin}, {doubt} {where} {clause}{figures}{source}."
    if blocked is not None:
        return f"{begin}, {'although' if joined else 'and'} the map shows an obstacle after {blocked:.1f} m."
    refusal: Decision = next((way.refusal for way in ways if way.refusal), "")
    if refusal and not joined:
        free = "the path is free, but " if refusal in SPARED else ""
        return f"{begin}, because {free}{DECISIONS[refusal].clause}."
    measured = all(way.source == "measured" for way in ways)
    if any(way.found is not None and way.covered >= _COVERED for way in ways):
        known = "the evidence of both directions" if measured else "the evidence of overlapping corridors"
        return f"{begin}, and {known} supports it."
    if unknown == 0.0:
        return f"{begin}; nothing was measured along it, but the map shows free space."
    return f"{begin}, and nothing was measured along the {meters:.2f} m between them."
