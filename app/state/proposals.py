"""Proposed and doubtful edges, and proposed viewpoints, until the user decides. Does not use Qt."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.graph.proposals import PlaceProposal
from nvsim.graph.types import EdgeKey, NavGraph


@dataclass
class Proposals:
    """The open proposals.

    edges    missing edges whose corridor passes the thresholds
    doubted  existing edges whose corridor fails a threshold
    places   proposed viewpoints with their possible edges
    """

    edges: tuple[EdgeKey, ...] = ()
    doubted: tuple[EdgeKey, ...] = ()
    places: tuple[PlaceProposal, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.edges or self.places)

    def add(
        self,
        edges: tuple[EdgeKey, ...],
        doubted: tuple[EdgeKey, ...] = (),
        places: tuple[PlaceProposal, ...] = (),
    ) -> None:
        """Adds proposals to the existing ones."""
        self.places = tuple({place.new_id: place for place in (*self.places, *places)}.values())
        self.edges = tuple(dict.fromkeys((*self.edges, *edges)))
        self.doubted = tuple(dict.fromkeys((*self.doubted, *doubted)))

    def without(self, edge: EdgeKey) -> None:
        """Removes the proposal of an edge."""
        self.edges = tuple(key for key in self.edges if key != edge)

    def clear(self) -> None:
        self.edges, self.doubted, self.places = (), (), ()

    def prune(self, graph: NavGraph | None) -> bool:
        """Removes proposals that exist in the graph or whose ends were removed. Returns whether any was removed."""
        before = (self.edges, self.doubted, self.places)
        if graph is None:
            self.clear()
        else:
            self.edges = tuple(
                key for key in self.edges if key not in graph.edges and all(end in graph.viewpoints for end in key)
            )
            self.doubted = tuple(key for key in self.doubted if key in graph.edges)
            self.places = tuple(place for place in self.places if place.new_id not in graph.viewpoints)
        return before != (self.edges, self.doubted, self.places)
