"""The columns of the tables of viewpoints and edges."""

from __future__ import annotations

import math

from app.layers.labels import short_id
from app.look import lengths
from app.look.table import Column
from nvsim.graph.clearness_cache import ClearnessCache
from nvsim.graph.types import EdgeKey, NavGraph

_WIDTH = 76  # pixels
_ORIGIN = "Created by a step of the search, a merge, a user, or a file"


def _yes(value: object) -> str:
    return "yes" if value else "–"


def _share(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f}"


def viewpoint_columns(graph: NavGraph) -> tuple[Column[str], ...]:
    """The columns of rows that are ids of viewpoints of `graph`."""
    of = graph.viewpoints

    def length(title: str, tip: str, axis: int | None) -> Column[str]:
        return Column(
            title, lambda id: of[id].height if axis is None else of[id].position[axis], lengths.figure, tip,
            number=True, width=_WIDTH, measured=True,
        )  # fmt: skip

    return (
        Column("Viewpoint", lambda id: id, lambda id: short_id(graph, id), "Identifier", width=_WIDTH),
        Column("Degree", lambda id: len(graph.neighbours(id)), str, "Number of edges", number=True, width=_WIDTH),
        Column("Submap", lambda id: of[id].submap, lambda v: "–" if v < 0 else str(v), "Submap that renders it",
               number=True, width=_WIDTH),
        length("Height", "Height above the floor", None),
        *(length(title, "Camera position", axis) for axis, title in enumerate("xyz")),
        Column("Included", lambda id: of[id].included, _yes, "Whether agents use it", width=_WIDTH),
        Column("Reviewed", lambda id: of[id].reviewed, _yes, "Whether a user reviewed it", width=_WIDTH),
        Column("Locked", lambda id: of[id].locked, _yes, "Whether it is protected from edits", width=_WIDTH),
        Column("Origin", lambda id: of[id].origin, str, _ORIGIN, width=_WIDTH),
    )  # fmt: skip


def edge_columns(graph: NavGraph, evidence: ClearnessCache) -> tuple[Column[EdgeKey], ...]:
    """The columns of rows that are keys of edges of `graph`, with the cached `evidence` of its edges."""
    of = graph.edges

    def length(key: EdgeKey) -> float:
        a, b = (graph.viewpoints[id].position for id in key)
        return math.dist(a, b)

    return (
        Column("From", lambda key: key[0], lambda id: short_id(graph, id), "First viewpoint", width=_WIDTH),
        Column("To", lambda key: key[1], lambda id: short_id(graph, id), "Second viewpoint", width=_WIDTH),
        Column("Length", length, lengths.figure, "From camera to camera", number=True, width=_WIDTH, measured=True),
        Column("Evidence", lambda key: evidence.at(graph, key), _share,
               "1 if every measured corridor is clear, 0 if one is blocked; – without evidence",
               number=True, width=_WIDTH),
        Column("Reviewed", lambda key: of[key].reviewed, _yes, "Whether a user reviewed it", width=_WIDTH),
        Column("Locked", lambda key: of[key].locked, _yes, "Whether it is protected from edits", width=_WIDTH),
        Column("Origin", lambda key: of[key].origin, str, _ORIGIN, width=_WIDTH),
    )  # fmt: skip
