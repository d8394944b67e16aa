"""What the machine proposes and doubts, until a user decides. Knows no Qt."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.graph.proposals import PlaceProposal
from nvsim.graph.types import EdgeKey, NavGraph


@dataclass
class Proposals:
    """edges    that are not there although their corridor passes
    doubted  that are there although it does not
    places   where a viewpoint is missing, each with what it can be joined to
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
        """These too."""
        self.places = tuple({place.new_id: place for place in (*self.places, *places)}.values())
        self.edges = tuple(dict.fromkeys((*self.edges, *edges)))
        self.doubted = tuple(dict.fromkeys((*self.doubted, *doubted)))

    def without(self, edge: EdgeKey) -> None:
        """That edge is proposed no more."""
        self.edges = tuple(key for key in self.edges if key != edge)

    def clear(self) -> None:
        self.edges, self.doubted, self.places = (), (), ()

    def prune(self, graph: NavGraph | None) -> bool:
        """Drops what is there already or whose ends are gone. Returns whether anything was dropped."""
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
