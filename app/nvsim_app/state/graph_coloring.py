"""Colors the graph by a property: assigns a group to every viewpoint and edge, with a legend."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.quantities import QuantityInputs, quantity
from nvsim.mapping.explanation.explain import smallest_margin
from nvsim_app.look import colors
from nvsim_app.state.document import Document

MOST_MARGINS = 2000  # maximum number of edges for which all criteria are evaluated; else only the worst row of alpha
_NONE = "#8d99a6"
_STEPS = ("#e05d5d", "#f28e2b", "#edc948", "#59a14f")  # from bad to good, distinct in brightness too
_DEGREES = ("#e05d5d", "#f28e2b", "#edc948", "#59a14f", "#4e79a7", "#b07aa1")


@dataclass(frozen=True)
class Group:
    """One color with its meaning. `mark` selects a shape of viewpoints and a line style, which repeat the meaning
    without color."""

    color: str
    words: str
    mark: int = 0


@dataclass(frozen=True, eq=False)
class Coloring:
    """The colors of a graph. Viewpoints and edges without a group keep their color.

    title        title of the legend
    groups       the groups of the legend
    viewpoints   viewpoint id -> index in groups
    edges        edge key -> index in groups
    """

    title: str
    groups: tuple[Group, ...]
    viewpoints: Mapping[str, int]
    edges: Mapping[tuple[str, str], int]

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """(G,) int64 number of viewpoints of each group; number of edges if the group has no viewpoints."""
        found = [np.bincount(list(of.values()), minlength=len(self.groups)) for of in (self.viewpoints, self.edges)]
        return np.asarray(np.where(found[0] > 0, found[0], found[1]), np.int64)


_Bins = Callable[[NDArray[np.float64]], NDArray[np.int64]]


def coloring(document: Document, by: str) -> Coloring | None:
    """The coloring of the graph by the property `by`; None if there is no graph. Raises EditError if the property needs
    an occupancy map and there is none."""
    graph = document.graph
    if graph is None:
        return None
    config, few = document.contents.thresholds, len(graph.edges) <= MOST_MARGINS
    slack = smallest_margin(config) if few else lambda g, key: config.row_alpha - 1.0 + document.evidence.at(g, key)
    known = QuantityInputs(document.contents.occupancy, slack)

    def groups_of(kind: str, bins: _Bins) -> dict[object, int]:
        names, values = quantity(graph, by, known, kind)  # type: ignore[arg-type]
        return dict(zip(names, bins(values.astype(np.float64)).tolist(), strict=True))

    if by == "degree":
        groups = [
            Group(c, w, mark)
            for mark, (c, w) in enumerate(zip(_DEGREES, ("none", "1", "2", "3", "4 or 5", "6 or more"), strict=True))
        ]
        return _make_coloring(
            "Neighbors", groups, groups_of("viewpoints", lambda v: np.searchsorted([0.5, 1.5, 2.5, 3.5, 5.5], v)), {}
        )
    if by == "evidence":
        # Most margins of a graph are alike, so fixed limits would give one color to all edges.
        keys, measured = quantity(graph, by, known, "edges")
        margins = measured.astype(np.float64)
        passing = margins[margins >= 0.0]
        thirds = np.unique(np.quantile(passing, (1 / 3, 2 / 3)).round(3)) if len(passing) else np.zeros(0)
        limits = [0.0, *thirds[thirds > 0.0].tolist()]
        words = [f"passes by {low:.3g} to {high:.3g}" for low, high in zip(limits, limits[1:])]
        words.append(f"passes by {limits[-1]:.3g} or more" if len(limits) > 1 else "passes")
        passes = [Group(c, w, mark) for c, w, mark in zip(_STEPS[-len(words) :], words, (2, 3, 0)[-len(words) :])]
        groups = [Group(_STEPS[0], "fails", 1), *passes, Group(_NONE, "none", 4)]

        def bins(values: NDArray[np.float64]) -> NDArray[np.int64]:
            found = np.searchsorted(limits, values, side="right")
            return np.where(np.isnan(values), len(groups) - 1, found)

        title = "Evidence" if few else "Evidence (worst row of alpha)"
        return _make_coloring(title, groups, groups_of("viewpoints", bins), dict(zip(keys, bins(margins).tolist())))
    if by == "photographed":
        limits = [config.photographed, (1 + config.photographed) / 2]
        groups = [
            Group(_STEPS[0], f"below {limits[0]:.0%}", 1),
            Group(_STEPS[2], f"{limits[0]:.0%} to {limits[1]:.0%}", 2),
            Group(_STEPS[3], f"{limits[1]:.0%} or more"),
            Group(_NONE, "not measured", 4),
        ]

        def shares(values: NDArray[np.float64]) -> NDArray[np.int64]:
            return np.where(np.isnan(values), 3, np.searchsorted(limits, values, side="right"))

        return _make_coloring("Photographed directions", groups, groups_of("viewpoints", shares), {})
    if by in ("reviewed", "validity"):
        yes, no = ("reviewed", "not reviewed") if by == "reviewed" else ("free on the map", "not free on the map")
        groups = [Group(_NONE if by == "reviewed" else _STEPS[0], no, 1), Group(_STEPS[3], yes)]
        title = "Reviewed" if by == "reviewed" else "Validity"
        return _make_coloring(title, groups, groups_of("viewpoints", _to_integers), groups_of("edges", _to_integers))
    found = groups_of("viewpoints", _to_integers), groups_of("edges", _to_integers)
    numbers = sorted({*found[0].values(), *found[1].values()})
    row = {number: i for i, number in enumerate(numbers)}
    title, noun = {"storey": ("Storeys", "storey"), "component": ("Components", "component")}.get(
        by, ("Submaps", "submap")
    )
    groups = [
        Group(colors.submap_color(n), f"{noun} {n}" if n >= 0 else "none", mark) for mark, n in enumerate(numbers)
    ]
    return _make_coloring(title, groups, *({name: row[n] for name, n in each.items()} for each in found))


def _to_integers(values: NDArray[np.float64]) -> NDArray[np.int64]:
    return values.astype(np.int64)


def _make_coloring(
    title: str, groups: list[Group], viewpoints: Mapping[object, int], edges: Mapping[object, int]
) -> Coloring:
    return Coloring(title, tuple(groups), viewpoints, edges)  # type: ignore[arg-type]
