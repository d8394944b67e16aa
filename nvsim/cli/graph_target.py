"""The graph that a command reads or edits: of a project, of a connectivity file, or of every scan in a folder."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.cli import terminal
from nvsim.errors import InputError
from nvsim.graph.edits import EditError
from nvsim.graph.history import History
from nvsim.graph.journal import Journal, sidecar
from nvsim.graph.operations import EditContext
from nvsim.graph.quantities import QuantityInputs
from nvsim.graph.types import NavGraph
from nvsim.occupancy.types import Heights, OccupancyMap
from nvsim.plain_text import count_text

if TYPE_CHECKING:
    from nvsim.graph.edits import Visible
    from nvsim.graph.findings import Context, Limits
    from nvsim.graph.foreign import ForeignFile
    from nvsim.graph.types import EdgeKey


@dataclass(frozen=True, eq=False)
class GraphWithContext:
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
) -> Iterator[GraphWithContext]:
    """Yields every graph at `path`. `occupancy` is a map to use instead of the one found there, limited to `heights` if
    it has heights.

    Raises InputError if there is no graph, or it cannot be read.
    """
    map = None
    if occupancy is not None:
        from nvsim.occupancy.read import read_map

        map = read_map(occupancy, heights)
        terminal.print_notes(map.notes)
    if is_project(path):
        from nvsim.mapping.explanation.explain import smallest_margin
        from nvsim.project.graph import context_of, thresholds_of
        from nvsim.project.project import Project

        with Project.open(path) as project:
            context = context_of(project, limits, map)
            yield GraphWithContext(
                path, project.scan_name, project.need_graph(), context, smallest_margin(thresholds_of(project))
            )
        return
    from nvsim.graph.foreign import ForeignFile, connectivity_files

    for file in connectivity_files(path):
        foreign = ForeignFile.open(file)
        beside = foreign.nearby_files.occupancy() if map is None else None
        terminal.print_notes(() if beside is None else beside.notes)
        context = foreign.context(limits, beside if map is None else map)
        yield GraphWithContext(file, foreign.scan, foreign.graph, context, None, foreign.visibility(unknown=False))


def read_one_graph(path: Path, occupancy: Path | None = None, heights: Heights | None = None) -> GraphWithContext:
    """The one graph at `path`. Raises InputError if there are several."""
    found = sources(path, None, occupancy, heights)
    first = next(found)
    if next(found, None) is not None:
        raise InputError(f"{path} contains several scans; name the connectivity file of one.")
    return first


class GraphTarget:
    """A graph in a project folder or a file, with its context. Raises InputError if the path does not exist."""

    def __init__(self, path: Path, occupancy: Path | None = None, heights: Heights | None = None) -> None:
        self.path = Path(path).expanduser().absolute()
        self.is_project = os.path.isdir(self.path)
        if not os.path.exists(self.path):
            raise InputError(f"{path} does not exist; name a project or an R2R connectivity file.")
        self._map, self._heights = occupancy, heights

    def read(self) -> NavGraph:
        """The saved graph."""
        if self.is_project:
            from nvsim.project.project import Project

            with Project.open(self.path) as project:
                return project.need_graph()
        return self._foreign.graph

    def known(self, expression: str) -> QuantityInputs:
        """Data that an expression may need: a map if it uses `validity`, and in a project the thresholds of the graph,
        for `evidence`."""
        margin = None
        if self.is_project:
            from nvsim.mapping.explanation.explain import smallest_margin as of_thresholds
            from nvsim.project.graph import thresholds_of
            from nvsim.project.project import Project

            with Project.open(self.path) as project:
                margin = of_thresholds(thresholds_of(project))
        return QuantityInputs(self._occupancy() if "validity" in expression else None, margin)

    def surroundings(self) -> EditContext:
        from nvsim.graph.sight import line_of_sight_test

        occupancy, walk = self._occupancy(), None
        if self.is_project:
            from nvsim.project.project import Project

            with Project.open(self.path) as project:
                capture = project.capture()
                walk = None if capture is None else capture.positions
        if occupancy is not None:
            return EditContext(line_of_sight_test(occupancy), walk)
        return EditContext(None if self.is_project else self._foreign.visibility(), walk)

    def journal(self) -> Journal:
        """The journal of its edits. Raises InputError if its folder cannot be written."""
        if self.is_project:
            from nvsim.project.layout import Layout

            return Journal.open(Layout(self.path).edits)
        return Journal.open(sidecar(self.path), plain=True)

    @contextmanager
    def editing(self) -> Iterator[History]:
        """Yields its history, to which the block adds steps. The resulting graph is saved if the block ends without an
        error.

        Raises InputError if a window is editing the graph, or left unsaved edits."""
        with self.journal() as journal:
            if journal.busy:
                raise InputError(f"{self.path} is being edited in a window; close it there first.")
            if journal.refusal is not None:
                raise InputError(journal.refusal)
            history = journal.history(self.read())
            if not history.is_saved:
                raise InputError(
                    f"{self.path} has {count_text(journal.recovered, 'unsaved edit')}; open it in the window and save "
                    "or undo them first."
                )
            yield history
            if history.is_saved:
                return
            journal.flush()
            self.write(history.graph)
            history.mark_saved()

    def write(self, graph: NavGraph, out: Path | None = None) -> Path:
        """Saves the graph completely or not at all; returns the written path. `out` names a connectivity file to write
        instead. For a foreign file, parts that were not edited stay unchanged."""
        if not self.is_project:
            return self._foreign.save(graph, out)
        from nvsim.project.project import Project

        if out is not None:
            from nvsim.graph.foreign import ForeignFile
            from nvsim.graph.foreign.document import Document

            return ForeignFile(out, Document(), None).save(graph)
        with Project.open(self.path, writable=True) as project:
            project.set_graph(graph)
        return self.path

    @property
    def original(self) -> Path | None:
        """The file that keeps the unedited connectivity file; None for a project."""
        return None if self.is_project else self._foreign.original

    @cached_property
    def _foreign(self) -> ForeignFile:
        from nvsim.graph.foreign import ForeignFile

        return ForeignFile.open(self.path)

    def _occupancy(self) -> OccupancyMap | None:
        found = self._read_occupancy()
        terminal.print_notes(() if found is None else found.notes)
        return found

    def _read_occupancy(self) -> OccupancyMap | None:
        if self._map is not None:
            from nvsim.occupancy.read import read_map

            return read_map(self._map, self._heights)
        if self.is_project:
            from nvsim.project.occupancy_maps import occupancy_of
            from nvsim.project.project import Project

            with Project.open(self.path) as project:
                return occupancy_of(project)
        return self._foreign.nearby_files.occupancy()


@contextmanager
def edit_errors_as_input_errors(where: str = "") -> Iterator[None]:
    """Turns an EditError in the block into an InputError with its message after the prefix `where`."""
    try:
        yield
    except EditError as error:
        raise InputError(f"{where}{error}") from error
