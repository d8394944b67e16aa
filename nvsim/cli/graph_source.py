"""Read the graph that a command names: of a project, of a connectivity file, or of every scan in a folder of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.cli import show
from nvsim.errors import InputError

if TYPE_CHECKING:
    from nvsim.graph.edits import Visible
    from nvsim.graph.findings import Context, Limits
    from nvsim.graph.types import EdgeKey, NavGraph
    from nvsim.occupancy.heights import Heights
    from nvsim.occupancy.types import OccupancyMap


@dataclass(frozen=True, eq=False)
class Source:
    """A graph and its context.

    path, name    its file or project, and its name
    margin        how certain an edge is by its evidence; None if there is no evidence
    occupancy     its occupancy map, None if there is none
    visible       which viewpoints see each other by the lists of a connectivity file; None if there are none
    """

    path: Path
    name: str
    graph: NavGraph
    context: Context
    margin: Callable[[NavGraph, EdgeKey], float] | None = None
    visible: Visible | None = None

    @property
    def occupancy(self) -> OccupancyMap | None:
        return self.context.occupancy


def is_project(path: Path) -> bool:
    """Whether `path` is a project folder."""
    from nvsim.project.path_kind import path_kind

    return path_kind(path) == "project"


def sources(
    path: Path, limits: Limits | None = None, occupancy: Path | None = None, heights: Heights | None = None
) -> Iterator[Source]:
    """Yields every graph at `path`. `occupancy` is a map to use instead of the one found there, limited to `heights` if
    it has heights.

    Raises InputError if there is no graph, or it cannot be read.
    """
    map = None
    if occupancy is not None:
        from nvsim.occupancy.read import read_map

        map = read_map(occupancy, heights)
        show.notes(map.notes)
    if is_project(path):
        from nvsim.mapping.explanation.edge_doubts import margin
        from nvsim.project.graph import context_of, thresholds_of
        from nvsim.project.project import Project

        with Project.open(path) as project:
            context = context_of(project, limits, map)
            yield Source(path, project.scan_name, project.need_graph(), context, margin(thresholds_of(project)))
        return
    from nvsim.graph.foreign import ForeignFile, connectivity_files

    for file in connectivity_files(path):
        foreign = ForeignFile.open(file)
        beside = foreign.beside.occupancy() if map is None else None
        show.notes(() if beside is None else beside.notes)
        context = foreign.context(limits, beside if map is None else map)
        yield Source(file, foreign.scan, foreign.graph, context, None, foreign.sight(unknown=False))


def one_source(path: Path, occupancy: Path | None = None, heights: Heights | None = None) -> Source:
    """The one graph at `path`. Raises InputError if there are several."""
    found = sources(path, None, occupancy, heights)
    first = next(found)
    if next(found, None) is not None:
        raise InputError(f"{path} contains several scans; name the connectivity file of one.")
    return first
