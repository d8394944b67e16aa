"""Proposed and doubtful edges, and proposed viewpoints, until the user decides. Does not use Qt."""

from __future__ import annotations

from dataclasses import dataclass, field

from nvsim.graph.proposals import PlaceProposal
from nvsim.graph.types import EdgeKey, Evidence, NavGraph


@dataclass(frozen=True, eq=False)
class _ProposalBasis:
    """What an edge was judged by: the positions of its ends, and the evidence measured there."""

    positions: dict[str, tuple[float, float, float]]
    evidence: tuple[Evidence, ...]

    @staticmethod
    def of(graph: NavGraph, key: EdgeKey) -> _ProposalBasis:
        ends = {id: graph.viewpoints[id].position for id in key if id in graph.viewpoints}
        return _ProposalBasis(ends, tuple(graph.evidence[row] for id in ends for row in graph.evidence_of.get(id, ())))

    def is_unchanged_in(self, graph: NavGraph) -> bool:
        """Whether all of it is in `graph`, which contains the ends. An undo restores identical objects."""
        return all(graph.viewpoints[id].position == at for id, at in self.positions.items()) and all(
            graph.evidence.get(found.key) is found for found in self.evidence
        )


@dataclass
class Proposals:
    """The open proposals.

    edges    missing edges whose corridor passes the thresholds
    doubted  existing edges whose corridor fails a threshold
    places   proposed viewpoints with their possible edges

    A proposed or doubtful edge belongs to the positions and the evidence that it was found with. If an undo removes
    them, the edge is no longer proposed or doubtful.
    """

    edges: tuple[EdgeKey, ...] = ()
    doubted: tuple[EdgeKey, ...] = ()
    places: tuple[PlaceProposal, ...] = ()
    _grounds: dict[EdgeKey, _ProposalBasis] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.edges or self.places)

    def add(
        self,
        graph: NavGraph,
        edges: tuple[EdgeKey, ...],
        doubted: tuple[EdgeKey, ...] = (),
        places: tuple[PlaceProposal, ...] = (),
    ) -> None:
        """Adds proposals that were found in `graph` to the existing ones."""
        self._grounds |= {key: _ProposalBasis.of(graph, key) for key in (*edges, *doubted)}
        self.places = tuple({place.new_id: place for place in (*self.places, *places)}.values())
        self.edges = tuple(dict.fromkeys((*self.edges, *edges)))
        self.doubted = tuple(dict.fromkeys((*self.doubted, *doubted)))

    def remove_edge(self, edge: EdgeKey) -> None:
        """Removes the proposal of an edge."""
        self.edges = tuple(key for key in self.edges if key != edge)

    def clear(self) -> None:
        self.edges, self.doubted, self.places, self._grounds = (), (), (), {}

    def prune(self, graph: NavGraph | None) -> bool:
        """Removes proposals that exist in the graph, and those whose ends or grounds are gone. Returns whether any was
        removed."""
        before = (self.edges, self.doubted, self.places)
        if graph is None:
            self.clear()
        else:
            self._grounds = {
                key: grounds
                for key, grounds in self._grounds.items()
                if all(end in graph.viewpoints for end in key) and grounds.is_unchanged_in(graph)
            }
            self.edges = tuple(key for key in self.edges if key in self._grounds and key not in graph.edges)
            self.doubted = tuple(key for key in self.doubted if key in self._grounds and key in graph.edges)
            self.places = tuple(place for place in self.places if place.new_id not in graph.viewpoints)
        return before != (self.edges, self.doubted, self.places)
