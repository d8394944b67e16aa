"""The navigation graph as a value: viewpoints, undirected edges, and the evidence behind every decision.

Values are never changed in place: an edit is a function graph -> graph. Viewpoints are identified by their id.
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
    """A node of the graph: a position at which an agent can stand.

    id        unique in the graph, without "/" (the map builder uses 32 lower-case hex digits, as in Matterport3D)
    position  (x, y, z) of the camera, meters, world
    height    meters of the camera above the floor
    submap    index of the submap that renders it, -1 for none
    included  False keeps the viewpoint in files but excludes it from navigation (R2R "included")
    origin    source of the viewpoint: "start" or "step" (map builder), "person" (a user), or "file"
    reviewed  a user checked it and found it correct
    locked    edits refuse to move, change or remove it
    photographed  share of the directions around it, 0 to 1, that show surfaces which training images show; None if it
                  was not measured
    """

    id: str
    position: tuple[float, float, float]
    height: float = 1.5
    submap: int = -1
    included: bool = True
    origin: ViewpointOrigin = "step"
    reviewed: bool = False
    locked: bool = False
    photographed: float | None = None


@dataclass(frozen=True)
class Edge:
    """An undirected navigable segment; a < b as strings.

    origin    "step" (a corridor of length tau_dist was checked), "merge" (the corridor to an existing viewpoint was
              checked), "person" (a user), or "file"
    reviewed  a user checked it and found it correct
    locked    edits refuse to remove it, and to move its ends
    """

    a: str
    b: str
    origin: EdgeOrigin = "step"
    reviewed: bool = False
    locked: bool = False

    @property
    def key(self) -> tuple[str, str]:
        """The key of this edge in `NavGraph.edges`: both ids, in alphabetical order."""
        return (self.a, self.b)


def edge(a: str, b: str, origin: EdgeOrigin = "step") -> Edge:
    """Return the edge between two ids in either order. Raises ValueError if they are equal."""
    if a == b:
        raise ValueError(f"an edge from viewpoint {a} to itself")
    return Edge(min(a, b), max(a, b), origin)


@dataclass(frozen=True, eq=False)
class SecondOpinion:
    """The measurements of a corridor from the model of another submap that was trained there too.

    submap                               index of that submap
    alpha, up, reach, mass, network_up   (rows, cells) uint8, as in Evidence
    """

    submap: int
    alpha: NDArray[np.uint8]
    up: NDArray[np.uint8]
    reach: NDArray[np.uint8] | None = None
    mass: NDArray[np.uint8] | None = None
    network_up: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class Evidence:
    """The measurements from one viewpoint along one corridor, enough to decide again without rendering.

    viewpoint   id of the viewpoint
    direction   0 to 7 for the lattice directions; 8 and up for corridors to an existing viewpoint (a merge)
    heading     radians, 0 is +y, positive turns right
    length      meters from the viewpoint to the position that the step leads to
    alpha       (rows, cells) uint8, accumulated alpha * 255 on the floor cells of the corridor. Row r covers [near + r
                * depth, near + (r + 1) * depth] ahead; cell c is an equal share of `width` from left to right. 255 also
                for cells outside the image. 0 for cells over which the camera was carried (near stairs, or anywhere
                without a LiDAR scan), and near stairs for cells that the corridor back shows better
    up          (rows, cells) uint8, upward normal component * 255 (negative as 0)
    support     (rows, cells) bool, whether a floor mask or a point of the cloud shows floor
    near, depth, width   meters: start of the first row, depth of a row, full width of the corridor
    submap      index of the submap whose model was rendered
    target      (x, y) meters, world, that the step leads to
    joins       id of the existing viewpoint that the corridor leads to, "" for a lattice step
    decision    under the thresholds of the build: "open", or the first criterion that failed: "alpha", "normal",
                "network-normal", "depth", "slice", "unknown", "disputed" (only one of two submap models calls it open),
                "distance", "limit", "merge", "return" (the corridor back). Or the reason why a free corridor has no
                edge: "spare" (another path is hardly longer), "served" (other viewpoints are near its end), "around"
                (the trajectory goes around it, which without a LiDAR scan may be due to a glass pane)
    stale       whether the viewpoint, or the one it leads to, was moved after the measurement
    reach       (rows, cells) uint8, share of the distance to the floor of a cell that the rendered depth reaches * 255;
                light that passes all Gaussians reaches the floor. 0 for cells outside the image. None: not measured
    mass        (rows, cells) uint8, share of the cell that Gaussians cover between 0.1 m above the floor and the
                camera, seen from above, * 255. None: not measured
    second      measurements from the model of another submap; None if no other model was used
    network_up  (rows, cells) uint8, upward component of the normals that a network predicts for the rendered view * 255
                (negative as 0); 0 for cells outside the image. None: not measured
    views       "pitched": read from a view that looks down along the corridor; "panorama": read from a panorama of the
                viewpoint
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
        """The key of this evidence in `NavGraph.evidence`: the viewpoint and the direction."""
        return (self.viewpoint, self.direction)


def _read_only_mapping(mapping: Mapping[Any, Any]) -> Mapping[Any, Any]:
    return mapping if isinstance(mapping, MappingProxyType) else MappingProxyType(dict(mapping))


@dataclass(frozen=True, eq=False)
class NavGraph:
    """An immutable navigation graph.

    scan        the scan id: no underscore, no white space, no slash (agents split keys at "_")
    viewpoints  id -> Viewpoint, in file order
    edges       (a, b) with a < b -> Edge; both ends are viewpoints
    evidence    (viewpoint id, direction) -> Evidence
    ignored     key of a finding -> the user's reason for ignoring it
    """

    scan: str
    viewpoints: Mapping[str, Viewpoint] = field(default_factory=dict)
    edges: Mapping[EdgeKey, Edge] = field(default_factory=dict)
    evidence: Mapping[EvidenceKey, Evidence] = field(default_factory=dict)
    ignored: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("viewpoints", "edges", "evidence", "ignored"):
            object.__setattr__(self, name, _read_only_mapping(getattr(self, name)))

    @cached_property
    def adjacency(self) -> Mapping[str, tuple[str, ...]]:
        """id -> ids of its neighbors, in edge order; only viewpoints with edges. Computed once per graph; edits pass it
        on with their changes."""
        found: dict[str, list[str]] = {}
        for a, b in self.edges:
            found.setdefault(a, []).append(b)
            found.setdefault(b, []).append(a)
        return MappingProxyType({id: tuple(others) for id, others in found.items()})

    @cached_property
    def evidence_of(self) -> Mapping[str, tuple[EvidenceKey, ...]]:
        """id -> keys of the evidence measured from it, and of the corridors to it; only viewpoints with evidence."""
        found: dict[str, list[EvidenceKey]] = {}
        for key, evidence in self.evidence.items():
            found.setdefault(evidence.viewpoint, []).append(key)
            if evidence.joins:
                found.setdefault(evidence.joins, []).append(key)
        return MappingProxyType({id: tuple(keys) for id, keys in found.items()})

    @cached_property
    def short_length(self) -> int:
        """How many leading letters distinguish the ids of the viewpoints."""
        for letters in (6, 8):  # fast path for ids that are hashes
            if len({id[:letters] for id in self.viewpoints}) == len(self.viewpoints):
                return letters
        ids = sorted(self.viewpoints)
        return 1 + max(len(commonprefix(pair)) for pair in pairwise(ids))

    def short(self, id: str, least: int = 8) -> str:
        """Return an id as messages show it: `least` or more leading letters, enough to distinguish the viewpoints of
        this graph. Ids from scripts, such as house_01_0001, differ only at their end."""
        return id if len(id) <= least + 2 else id[: max(least, self.short_length)]

    def neighbors(self, viewpoint: str) -> tuple[str, ...]:
        """Return the ids joined to `viewpoint` by an edge, in edge order."""
        return self.adjacency.get(viewpoint, ())
