"""The details of selected edges, pairs of viewpoints, and multiple selections, as names and values. Does not use
widgets."""

from __future__ import annotations

import math

from nvsim.graph.findings.elements import slope
from nvsim.graph.review import distance
from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import Edge, EdgeKey, NavGraph, Viewpoint
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import CRITERIA
from nvsim.mapping.explanation.explain import closed_edge_reason, smallest_margin
from nvsim.mapping.explanation.path_explanation import DirectionExplanation, PathExplanation
from nvsim.plain_text import count_text
from nvsim_app.look import lengths

MOST = 500  # maximum number of selected objects for which details are computed; else only the number is shown

_ORIGINS = {
    "step": "a step of the search",
    "merge": "a corridor to an existing viewpoint",
    "person": "a user",
    "file": "an imported file",
}


def user_marks(viewpoint: Viewpoint) -> dict[str, str]:
    """The marks of a user on the viewpoint: excluded, reviewed, or locked. Empty if there are none."""
    marks = {} if viewpoint.included else {"In navigation": "no, excluded"}
    if viewpoint.reviewed:
        marks["Reviewed"] = "yes"
    if viewpoint.locked:
        marks["Locked"] = "yes"
    return marks


def photographed_of(viewpoint: Viewpoint) -> dict[str, str]:
    """The photographed share of the directions around a viewpoint. Empty if it was not measured."""
    share = viewpoint.photographed
    return {} if share is None else {"Photographed": f"{100 * share:.0f} % of the directions"}


def edge_details(graph: NavGraph, key: EdgeKey, config: MappingConfig) -> dict[str, str]:
    """The details of an edge as names and values. The evidence is compared with the thresholds of `config`."""
    edge = graph.edges[key]
    a, b = (graph.viewpoints[end].position for end in key)
    walked = all(graph.viewpoints[end].included for end in key)
    return {
        "Length": lengths.length(math.dist(a, b)),
        "Slope": f"{slope(graph, key):.0f}°",
        "Evidence": _evidence(graph, key, config),
        "Comes from": _ORIGINS.get(edge.origin, edge.origin),
        "Reviewed": "yes" if edge.reviewed else "no",
        **({"Locked": "yes"} if edge.locked else {}),
        **({} if walked else {"In navigation": "no, an end is excluded"}),
        "From": key[0],
        "To": key[1],
    }


def _evidence(graph: NavGraph, key: EdgeKey, config: MappingConfig) -> str:
    slack = smallest_margin(config)(graph, key)
    if math.isnan(slack):
        return "none, the edge was not measured"
    if slack >= 0:
        return f"passes the thresholds by {distance(slack)}"
    return f"fails a threshold by {distance(slack)}: {closed_edge_reason(config)(graph, key)}".rstrip(": ")


def pair_details(graph: NavGraph | None, found: PathExplanation) -> dict[str, str]:
    """The known facts about the segment between two viewpoints, as names and values. `verdicts` gives the criteria."""
    a, b = (way.start if graph is None else graph.short(way.start, 6) for way in found.ways)
    facts = {
        "Edge": "yes" if found.joined else "no",
        "Distance": lengths.length(found.meters)
        + (f", {lengths.length(found.rise, sign=True)} up" if abs(found.rise) >= 0.05 else ""),
        f"From {a}": _source(found.ways[0]),
        f"From {b}": _source(found.ways[1]),
    }
    if found.unknown is not None:
        unknown = f", {100 * found.unknown:.0f} % unknown" if found.unknown else ""
        stops = "free" if found.blocked is None else f"blocked after {lengths.length(found.blocked, 1)}"
        facts["On the map"] = f"{stops}{unknown}"
    return facts


def _source(way: DirectionExplanation) -> str:
    if way.source == "measured":
        return "measured"
    return f"covered {100 * way.covered:.0f} % by other corridors" if way.source else "not measured"


def verdicts(found: PathExplanation) -> list[tuple[str, list[tuple[str, bool | None]]]]:
    """The deciding criteria: name with threshold, and for each of the two directions the value as text and whether it
    passes; None if it was not measured."""
    by_criterion = [
        {} if way.found is None else {m.criterion.field: m for m in way.found.measures if m.decides}
        for way in found.ways
    ]
    rows: list[tuple[str, list[tuple[str, bool | None]]]] = []
    for criterion in CRITERIA:
        measures = [each.get(criterion.field) for each in by_criterion]
        first = next((m for m in measures if m is not None), None)
        if first is None:
            continue
        name = f"{criterion.name} {criterion.relation(True)} {first.limit:.2f}"
        rows.append((name, [("–", None) if m is None else (f"{m.value:.2f}", m.passes) for m in measures]))
    return rows


def selection_details(graph: NavGraph, chosen: GraphSelection) -> tuple[str, dict[str, str]]:
    """The details of a multiple selection: a title, and names and values."""
    ids = [id for id in chosen.viewpoints if id in graph.viewpoints]
    keys = [key for key in chosen.edges if key in graph.edges]
    parts = [(len(ids), "viewpoint"), (len(keys), "edge")]
    title = " and ".join(count_text(number, thing) for number, thing in parts if number)
    if len(ids) + len(keys) > MOST:
        return title, {}
    things: list[Viewpoint | Edge] = [*(graph.viewpoints[id] for id in ids), *(graph.edges[key] for key in keys)]
    facts = {
        "Reviewed": f"{sum(thing.reviewed for thing in things)} of {len(things)}",
        "Locked": f"{sum(thing.locked for thing in things)} of {len(things)}",
    }
    if ids:
        facts["In navigation"] = f"{sum(graph.viewpoints[id].included for id in ids)} of {len(ids)}"
        heights = sorted(graph.viewpoints[id].height for id in ids)
        low, high = heights[0], heights[-1]
        facts["Above the floor"] = (
            lengths.length(low) if high - low < 0.005 else f"{lengths.figure(low)} to {lengths.length(high)}"
        )
    if keys:
        long = [math.dist(*(graph.viewpoints[end].position for end in key)) for key in keys]
        facts["Length of edges"] = (
            f"{lengths.figure(min(long))} to {lengths.length(max(long))}, {lengths.length(sum(long))} in all"
        )
    return title, facts
