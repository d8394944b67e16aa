"""Comparison of the edited graph with another graph. Does not use Qt."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.errors import InputError
from nvsim.graph.compare import Comparison, Deviation, compare
from nvsim.graph.foreign import ForeignFile
from nvsim.graph.types import NavGraph
from nvsim.project.work import STAGE


@dataclass(frozen=True, eq=False)
class Compared:
    """Two graphs and their differences.

    name         display name of the other graph
    mine, other  the edited graph and the other graph
    """

    name: str
    mine: NavGraph
    other: NavGraph
    comparison: Comparison

    @staticmethod
    def of(name: str, mine: NavGraph, other: NavGraph) -> Compared:
        return Compared(name, mine, other, compare(mine, other))

    def place(self, id: str) -> tuple[float, float, float] | None:
        """The floor point of a viewpoint in meters, world: in the edited graph, else in the other graph."""
        found = self.mine.viewpoints.get(id) or self.other.viewpoints.get(self.comparison.matched.get(id, id))
        return None if found is None else _foot(found.position, found.height)

    def other_place(self, id: str) -> tuple[float, float, float] | None:
        """The floor point of a viewpoint in the other graph."""
        found = self.other.viewpoints.get(self.comparison.matched.get(id, id))
        return None if found is None else _foot(found.position, found.height)

    def of_kind(self, kind: str) -> list[Deviation]:
        return [d for d in self.comparison.deviations if d.kind == kind]


def read_graph(path: Path) -> NavGraph:
    """The graph of a connectivity file or a project. Raises InputError if it has no graph or cannot be read."""
    if path.is_dir():
        from nvsim.project.project import Project

        with Project.open(path) as project:
            graph = project.graph()
        if graph is None:
            raise InputError(f"{path} has no {STAGE['map'].result} yet; choose another.")
        return graph
    return ForeignFile.open(path).graph


def _foot(position: tuple[float, float, float], height: float) -> tuple[float, float, float]:
    return position[0], position[1], position[2] - height
