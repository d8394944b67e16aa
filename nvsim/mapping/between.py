"""Why there is an edge between two viewpoints, or none: the distance, the evidence of both ways with the verdict of
every criterion, what the map shows, and one sentence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nvsim.graph.quantities import evidence_along
from nvsim.graph.types import Decision, Evidence, NavGraph, edge
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import DECISIONS, OPEN, SPARED, lacking
from nvsim.mapping.explain import Explanation, explain
from nvsim.mapping.unmeasured import laid_over
from nvsim.occupancy.types import FREE, OCCUPIED, OccupancyMap

Source = Literal["measured", "others", ""]
_COVERED = 0.5  # of a corridor; where others cover less of it, they say nothing in its favour


@dataclass(frozen=True)
class Way:
    """One of the two ways.

    start, end   ids
    source       "measured" along it, "others": read from corridors that lie over it, "" where nothing is known
    covered      0 to 1, how much of it other corridors cover; 1 where it was measured
    found        the verdict of every criterion; None where nothing is known
    told         why the search made no edge of it although it was measured, "" where it did or was not asked
    """

    start: str
    end: str
    source: Source = ""
    covered: float = 0.0
    found: Explanation | None = None
    told: Decision = ""


@dataclass(frozen=True)
class Between:
    """joined    whether there is an edge
    metres    between the cameras; `rise` of the floor from the first to the second
    ways      from the first to the second and back
    blocked   metres along the straight way to the first occupied cell of the map, None where there is none
    unknown   0 to 1, the share of the way that the map does not know; None without a map
    sentence  the one thing that decided
    """

    joined: bool
    metres: float
    rise: float
    ways: tuple[Way, Way]
    blocked: float | None
    unknown: float | None
    sentence: str

    @property
    def speaks(self) -> int:
        """1 where what is known speaks for an edge, -1 against it, 0 where nothing is known."""
        found = [way for way in self.ways if way.found is not None]
        if self.blocked is not None or any(w.found is not None and w.found.decision != OPEN for w in found):
            return -1
        sure = any(way.covered >= _COVERED for way in found) or self.unknown == 0.0
        return 1 if sure else 0


def between(graph: NavGraph, a: str, b: str, config: MappingConfig, occupancy: OccupancyMap | None = None) -> Between:
    """What is known of the way between two different viewpoints of the graph. `occupancy` knows one floor."""
    first, second = graph.viewpoints[a], graph.viewpoints[b]
    joined = edge(a, b).key in graph.edges
    ways = _way(graph, a, b, config), _way(graph, b, a, config)
    blocked, unknown = _on_map(occupancy, first.position, second.position)
    rise = (second.position[2] - second.height) - (first.position[2] - first.height)
    metres = math.dist(first.position, second.position)
    sentence = _sentence(joined, ways, blocked, unknown, metres)
    return Between(joined, metres, rise, ways, blocked, unknown, sentence)


def _way(graph: NavGraph, here: str, there: str, config: MappingConfig) -> Way:
    measured = [e for e in evidence_along(graph, (here, there)) if e.viewpoint == here and not lacking(e, config)]
    if measured:
        found = [explain(e, config) for e in measured]
        worst = min(range(len(found)), key=lambda i: found[i].decision == OPEN)
        return Way(here, there, "measured", 1.0, found[worst], _told(measured[worst]))
    laid = laid_over(graph, here, there)
    if laid is None or lacking(laid[0], config):
        return Way(here, there)
    return Way(here, there, "others", laid[1], explain(laid[0], config))


def _told(evidence: Evidence) -> Decision:
    return "" if evidence.decision == OPEN else evidence.decision


def _on_map(
    occupancy: OccupancyMap | None, a: tuple[float, float, float], b: tuple[float, float, float]
) -> tuple[float | None, float | None]:
    if occupancy is None:
        return None, None
    length = math.dist(a[:2], b[:2])
    share = np.linspace(0.0, 1.0, max(2, math.ceil(2 * length / occupancy.resolution) + 1))
    cells = occupancy.at(np.array(a[:2]) + share[:, None] * (np.array(b[:2]) - a[:2]))
    stops = np.flatnonzero(cells == OCCUPIED)
    return float(share[stops[0]]) * length if len(stops) else None, float((cells != FREE).mean())


def _sentence(joined: bool, ways: tuple[Way, Way], blocked: float | None, unknown: float | None, metres: float) -> str:
    begin = "There is an edge" if joined else "There is no edge"
    against = next((w for w in ways if w.found is not None and w.found.decision != OPEN), None)
    if against is not None and against.found is not None:
        failed, where = against.found.failed, f"seen from {against.start}"
        figures = "" if failed is None else f" ({failed.name} {failed.value:.2f}, limit {failed.limit:.2f})"
        clause = DECISIONS[against.found.decision].clause
        doubt = "although" if joined else "because"
        source = "" if against.source == "measured" else ", by corridors that lie over it"
        return f"{begin}, {doubt} {where} {clause}{figures}{source}."
    if blocked is not None:
        return f"{begin}, {'although' if joined else 'and'} the map has something in the way after {blocked:.1f} m."
    told: Decision = next((way.told for way in ways if way.told), "")
    if told and not joined:
        free = "the way is free, but " if told in SPARED else ""
        return f"{begin}, because {free}{DECISIONS[told].clause}."
    measured = all(way.source == "measured" for way in ways)
    if any(way.found is not None and way.covered >= _COVERED for way in ways):
        known = "the evidence of both ways" if measured else "what is known of the way"
        return f"{begin}, and {known} speaks for it."
    if unknown == 0.0:
        return f"{begin}; nothing was measured along it, and the map shows it free."
    return f"{begin}, and nothing was measured along the {metres:.2f} m between them."
