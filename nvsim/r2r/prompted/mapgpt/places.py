"""What an agent knows of a graph: the places that it saw, numbered, and how they are joined as far as it was there."""

from __future__ import annotations

from nvsim.graph.types import NavGraph


class Places:
    """number    viewpoint id -> its number, in the order in which they were first seen; the start is 0
    seen_from  viewpoint id -> from where it was seen last; without the start, until that is seen from elsewhere
    been       viewpoint ids in the order in which the agent stood there
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
        """Where one can go from there in a step, in the order of their numbers."""
        return sorted(self._included(viewpoint), key=self.number.__getitem__)

    def go(self, viewpoint: str) -> None:
        """Stands there now, and sees what is around."""
        self.been.append(viewpoint)
        for neighbour in self._included(viewpoint):
            self.number.setdefault(neighbour, len(self.number))
            self.seen_from[neighbour] = viewpoint

    def trajectory_words(self) -> str:
        return " ".join(str(self.number[id]) for id in self.been)

    def map_words(self) -> str:
        """A line for each place where the agent was."""
        lines = []
        for id in sorted(set(self.been), key=self.number.__getitem__):
            joined = ", ".join(str(self.number[other]) for other in self.around(id))
            lines.append(f"Place {self.number[id]} is joined to {joined or 'nothing'}.")
        return "\n".join(lines)

    def elsewhere(self) -> list[str]:
        """Places seen, not gone to, and not around here."""
        near = {*self.been, *self.around(self.here)}
        return [id for id in self.number if id not in near]

    def elsewhere_words(self) -> str:
        far = [f"Place {self.number[id]}, next to place {self.number[self.seen_from[id]]}." for id in self.elsewhere()]
        return "\n".join(far) or "None."

    def _included(self, viewpoint: str) -> list[str]:
        found = (id for id in self._graph.neighbours(viewpoint) if self._graph.viewpoints[id].included)
        return sorted(found)
