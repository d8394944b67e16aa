"""Loads a navigation graph from a project or from an R2R connectivity file."""

from __future__ import annotations

from pathlib import Path

from nvsim.graph.connectivity import read_connectivity
from nvsim.graph.types import NavGraph
from nvsim.project.path_kind import path_kind
from nvsim.project.project import Project


def load_graph(path: Path) -> NavGraph:
    """The navigation graph of a project, or of an R2R connectivity file. Raises InputError if there is no graph, or if
    it cannot be read."""
    path = Path(path).expanduser()
    if path_kind(path) != "project":
        return read_connectivity(path)
    with Project.open(path) as project:
        return project.need_graph()
