"""Where a graph that is edited comes from and is saved to: a project's database, or a connectivity file of anyone's.
Knows no Qt."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from nvsim.graph.types import NavGraph


class GraphFile(Protocol):
    """foreign   whether it is a file of its own rather than part of a project
    journal   where the history of its editing lies
    """

    @property
    def name(self) -> str: ...
    @property
    def foreign(self) -> bool: ...
    @property
    def journal(self) -> Path | None: ...
    def save(self, graph: NavGraph) -> None:
        """Raises InputError when it cannot be written."""
        ...


class ProjectGraph:
    """The graph in a project's database."""

    foreign = False

    def __init__(self, project: Path) -> None:
        self._project = project

    @property
    def name(self) -> str:
        return self._project.name

    @property
    def journal(self) -> Path | None:
        from nvsim.project.layout import Layout

        return Layout(self._project).edits if Layout(self._project).database.is_file() else None

    def save(self, graph: NavGraph) -> None:
        from nvsim.project.project import Project

        with Project.open(self._project, writable=True) as project:
            project.set_graph(graph)
