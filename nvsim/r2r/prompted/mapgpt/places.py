"""The part of a graph that an agent knows: the numbered places it saw, and the edges of the places it visited."""

from __future__ import annotations

from nvsim.graph.types import NavGraph


class Places:
    """The known places.

    number     viewpoint id -> number, in the order in which they were first seen; the start is 0
    seen_from  viewpoint id -> viewpoint from which it was last seen; the start is missing until it is seen
    been       visited viewpoint ids in order
    """

    def __init__(self, graph: NavGraph, start: str) -> None:
        self._graph = graph
        self.number = {start: 0}
        self.seen_from: dict[str, str] = {}
        self.been: list[str] = []
        self.go(start)

    @property
    def here(self) -> str:
        return self.been[-1]

    def around(self, viewpoint: str) -> list[str]:
        """Returns the neighbors of a viewpoint, in the order of their numbers."""
        return sorted(self._included(viewpoint), key=self.number.__getitem__)

    def go(self, viewpoint: str) -> None:
        """Moves to a viewpoint and adds its neighbors to the seen places."""
        self.been.append(viewpoint)
        for neighbour in self._included(viewpoint):
            self.number.setdefault(neighbour, len(self.number))
            self.seen_from[neighbour] = viewpoint

    def trajectory_words(self) -> str:
        return " ".join(str(self.number[id]) for id in self.been)

    def map_words(self) -> str:
        """Returns one line for each visited place."""
        lines = []
        for id in sorted(set(self.been), key=self.number.__getitem__):
            joined = ", ".join(str(self.number[other]) for other in self.around(id))
            lines.append(f"Place {self.number[id]} is joined to {joined or 'nothing'}.")
        return "\n".join(lines)

    def elsewhere(self) -> list[str]:
        """Returns the places that were seen, but not visited, and are not neighbors of the current place."""
        near = {*self.been, *self.around(self.here)}
        return [id for id in self.number if id not in near]

    def elsewhere_words(self) -> str:
        far = [f"Place {self.number[id]}, next to place {self.number[self.seen_from[id]]}." for id in self.elsewhere()]
        return "\n".join(far) or "None."

    def _included(self, viewpoint: str) -> list[str]:
        found = (id for id in self._graph.neighbours(viewpoint) if self._graph.viewpoints[id].included)
        return sorted(found)
