"""The navigation graph as a value: viewpoints, undirected edges, and the evidence behind every decision.

Nothing here is ever changed in place: an edit is a function graph -> graph. Identity is the viewpoint id.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from os.path import commonprefix
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

EdgeKey = tuple[str, str]
EvidenceKey = tuple[str, int]
ViewpointOrigin = Literal["start", "step", "person", "file"]
EdgeOrigin = Literal["step", "merge", "person", "file"]
Views = Literal["pitched", "panorama"]
Decision = Literal[
    "",
    "open",
    "alpha",
    "normal",
    "network-normal",
    "depth",
    "slice",
    "unknown",
    "disputed",
    "distance",
    "limit",
    "merge",
    "return",
    "spare",
    "served",
    "around",
]


@dataclass(frozen=True)
class Viewpoint:
    """id        unique in the graph, without "/" (our builder: 32 lower-case hex digits, as in Matterport3D)
    position  (x, y, z) metres, world, of the camera
    height    metres of the camera above the floor
    submap    index of the submap that renders it, -1 where there is none
    included  False keeps the entry in files but out of navigation (R2R "included")
    origin    "start", "step", "person" or "file": who put it there
    reviewed  a user looked at it and found it right
    locked    edits refuse to move, change or remove it
    """

    id: str
    position: tuple[float, float, float]
    height: float = 1.5
    submap: int = -1
    included: bool = True
    origin: ViewpointOrigin = "step"
    reviewed: bool = False
    locked: bool = False


@dataclass(frozen=True)
class Edge:
    """An undirected navigable segment; a < b as strings. origin: "step" (a corridor of length tau_dist was checked),
    "merge" (the corridor to an existing viewpoint was checked), "person", "file". reviewed: a user looked at it and
    found it right. locked: edits refuse to remove it, and to move its ends."""

    a: str
    b: str
    origin: EdgeOrigin = "step"
    reviewed: bool = False
    locked: bool = False

    @property
    def key(self) -> tuple[str, str]:
        return (self.a, self.b)


def edge(a: str, b: str, origin: EdgeOrigin = "step") -> Edge:
    """The edge between two ids in either order. Raises ValueError when they are the same."""
    if a == b:
        raise ValueError(f"an edge from viewpoint {a} to itself")
    return Edge(min(a, b), max(a, b), origin)


@dataclass(frozen=True, eq=False)
class SecondOpinion:
    """What the model of another submap that was trained on the same place shows of a corridor.

    submap                               index of that submap
    alpha, up, reach, mass, network_up   as in Evidence
    """

    submap: int
    alpha: NDArray[np.uint8]
    up: NDArray[np.uint8]
    reach: NDArray[np.uint8] | None = None
    mass: NDArray[np.uint8] | None = None
    network_up: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class Evidence:
    """What was measured from one viewpoint along one corridor, enough to decide again without rendering.

    viewpoint   id it was measured from
    direction   0 to 7 for the lattice directions; 8 and up for corridors to an existing viewpoint (a merge)
    heading     radians, 0 is +y, positive turns right
    length      metres from the viewpoint to the place the step leads to
    alpha       (rows, cells) uint8, accumulated alpha * 255 on the floor cells of the corridor: row r covers
                [near + r * depth, near + (r + 1) * depth] ahead, cell c an equal share of `width` from left to right;
                255 also where a cell lies outside the image; 0 by a stair where somebody carried the camera over it,
                and where the corridor back shows it better
    up          (rows, cells) uint8, upward normal component * 255 (negative as 0)
    support     (rows, cells) bool, whether a floor mask or a cloud point says that there is floor
    near, depth, width   metres: start of the first row, depth of a row, full width of the corridor
    submap      index of the submap model that was rendered
    target      (x, y) where the step leads
    joins       id of the existing viewpoint that the corridor leads to, "" for a lattice step
    decision    under the thresholds it was built with: "open", or the first criterion that failed: "alpha", "normal",
                "network-normal", "depth", "slice", "unknown", "disputed" (one of two submap models calls it open),
                "distance", "limit", "merge", "return" (the corridor back); or why a free corridor got no edge:
                "spare" (another way is hardly longer), "served" (others stand near its end), "around" (the trajectory
                leads far around, which without a scan may have its reason in a pane of glass)
    stale       whether the viewpoint, or the one it leads to, stands elsewhere since this was measured
    reach       (rows, cells) uint8, share of the way to the cell's floor that the rendered depth reaches * 255, where
                what passes every Gaussian reaches it; 0 where a cell lies outside the image. None: not measured
    mass        (rows, cells) uint8, how much of the cell the Gaussians between 0.1 m above the floor and the camera
                cover, seen from above, * 255. None: not measured
    second      what the model of another submap shows of it, None where none was asked
    network_up  (rows, cells) uint8, upward component of the normals that a network sees in the rendered view * 255
                (negative as 0); 0 where a cell lies outside the image. None: not measured
    views       "pitched": read from a view that looks down along it; "panorama": from one of the viewpoint
    """

    viewpoint: str
    direction: int
    heading: float
    length: float
    alpha: NDArray[np.uint8]
    up: NDArray[np.uint8]
    support: NDArray[np.bool_]
    near: float
    depth: float
    width: float
    submap: int
    target: tuple[float, float]
    joins: str = ""
    decision: Decision = ""
    stale: bool = False
    reach: NDArray[np.uint8] | None = None
    mass: NDArray[np.uint8] | None = None
    second: SecondOpinion | None = None
    network_up: NDArray[np.uint8] | None = None
    views: Views = "pitched"

    @property
    def key(self) -> tuple[str, int]:
        return (self.viewpoint, self.direction)


def _frozen(mapping: Mapping[Any, Any]) -> Mapping[Any, Any]:
    return mapping if isinstance(mapping, MappingProxyType) else MappingProxyType(dict(mapping))


@dataclass(frozen=True, eq=False)
class NavGraph:
    """scan       the scan id: no underscore, no white space, no slash (agents split keys at "_")
    viewpoints  id -> Viewpoint, in file order
    edges       (a, b) with a < b -> Edge; both ends are viewpoints
    evidence    (viewpoint id, direction) -> Evidence
    ignored     key of a finding -> why a user lets it be
    """

    scan: str
    viewpoints: Mapping[str, Viewpoint] = field(default_factory=dict)
    edges: Mapping[EdgeKey, Edge] = field(default_factory=dict)
    evidence: Mapping[EvidenceKey, Evidence] = field(default_factory=dict)
    ignored: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("viewpoints", "edges", "evidence", "ignored"):
            object.__setattr__(self, name, _frozen(getattr(self, name)))

    @cached_property
    def adjacency(self) -> Mapping[str, tuple[str, ...]]:
        """id -> ids joined to it by an edge, in edge order; only viewpoints that have edges. Counted once per graph;
        edits hand it on with their change."""
        found: dict[str, list[str]] = {}
        for a, b in self.edges:
            found.setdefault(a, []).append(b)
            found.setdefault(b, []).append(a)
        return MappingProxyType({id: tuple(others) for id, others in found.items()})

    @cached_property
    def evidence_of(self) -> Mapping[str, tuple[EvidenceKey, ...]]:
        """id -> keys of the evidence measured from it, and of the corridors to it; only viewpoints that have any."""
        found: dict[str, list[EvidenceKey]] = {}
        for key, evidence in self.evidence.items():
            found.setdefault(evidence.viewpoint, []).append(key)
            if evidence.joins:
                found.setdefault(evidence.joins, []).append(key)
        return MappingProxyType({id: tuple(keys) for id, keys in found.items()})

    @cached_property
    def _letters(self) -> int:
        """How many leading letters tell the ids of the viewpoints apart."""
        for letters in (6, 8):  # enough for ids that are hashes, and quick
            if len({id[:letters] for id in self.viewpoints}) == len(self.viewpoints):
                return letters
        ids = sorted(self.viewpoints)
        return 1 + max(len(commonprefix(pair)) for pair in pairwise(ids))

    def short(self, id: str, least: int = 8) -> str:
        """An id as messages show it: as many letters as tell the viewpoints of this graph apart, `least` or more. Ids
        that scripts write, such as house_01_0001, differ at their end only."""
        return id if len(id) <= least + 2 else id[: max(least, self._letters)]

    def neighbours(self, viewpoint: str) -> tuple[str, ...]:
        """Ids joined to `viewpoint` by an edge, in edge order."""
        return self.adjacency.get(viewpoint, ())
