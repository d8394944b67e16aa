"""What the machine proposes and doubts, until a person decides. Knows no Qt."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.graph.types import EdgeKey, NavGraph


@dataclass
class Proposals:
    """edges    that are not there although their corridor passes
    doubted  that are there although it does not
    places   (x, y, z) metres, world, of cameras: where a viewpoint is missing
    """

    edges: tuple[EdgeKey, ...] = ()
    doubted: tuple[EdgeKey, ...] = ()
    places: tuple[tuple[float, float, float], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.edges or self.places)

    def add(
        self,
        edges: tuple[EdgeKey, ...],
        doubted: tuple[EdgeKey, ...] = (),
        places: tuple[tuple[float, float, float], ...] = (),
    ) -> None:
        """These too."""
        self.places = tuple(dict.fromkeys((*self.places, *places)))
        self.edges = tuple(dict.fromkeys((*self.edges, *edges)))
        self.doubted = tuple(dict.fromkeys((*self.doubted, *doubted)))

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
        return before != (self.edges, self.doubted, self.places)
