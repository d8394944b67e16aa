"""Where a graph that is edited comes from and is saved to: a project's database, or a connectivity file of anyone's.
Knows no Qt."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.edits import Visible
from nvsim.graph.findings import Context
from nvsim.graph.foreign import ForeignFile, words_of_saving
from nvsim.graph.journal import sidecar
from nvsim.graph.skybox_files import FOLDER
from nvsim.graph.types import NavGraph

PANORAMA_WIDTH = 1536  # pixels


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
    def save(self, graph: NavGraph) -> str:
        """Returns what the user should know, "" for nothing. Raises InputError when it cannot be written."""
        ...

    def sight(self, unknown: bool = True) -> Visible | None:
        """Who sees whom by the file's lists, and `unknown` where they say nothing; None where there are none."""
        ...

    def context(self, known: Context) -> Context:
        """What findings are held against: what is known already and what the file adds."""
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

    def save(self, graph: NavGraph) -> str:
        from nvsim.project.project import Project

        with Project.open(self._project, writable=True) as project:
            project.set_graph(graph)
        return ""

    def sight(self, unknown: bool = True) -> Visible | None:
        return None

    def context(self, known: Context) -> Context:
        return known


class ForeignGraph:
    """A connectivity file. What nobody edits is written back as it was read. `scans` are the files of its folder."""

    foreign = True

    def __init__(self, file: ForeignFile, scans: tuple[Path, ...] = ()) -> None:
        self._file, self.scans = file, scans

    @property
    def name(self) -> str:
        return self._file.path.name

    @property
    def journal(self) -> Path | None:
        return sidecar(self._file.path)

    def save(self, graph: NavGraph) -> str:
        path = self._file.save(graph)
        return words_of_saving(path, self._file.original, graph)

    def save_copy(self, graph: NavGraph, path: Path) -> None:
        """Writes `graph` to another file and leaves this one as it is. Raises InputError when it cannot be written."""
        copy.copy(self._file).save(graph, path)

    def export(self, graph: NavGraph, folder: Path) -> Path:
        """Writes `graph` under the same name into another folder; returns the file. Raises InputError when that is its
        own folder, or it cannot be written."""
        path = folder / self.path.name
        if path.resolve() == self.path.resolve():
            raise InputError(f"{path} is the file that is open; save it, or choose another folder.")
        self.save_copy(graph, path)
        return path

    def sight(self, unknown: bool = True) -> Visible | None:
        return self._file.sight(unknown)

    @property
    def pictured(self) -> bool:
        """Whether images of viewpoints lie beside it."""
        return self._file.beside.pictures is not None

    @property
    def path(self) -> Path:
        return self._file.path

    @property
    def skyboxes(self) -> Path | None:
        """The folder of skyboxes beside it, as Matterport3DSimulator reads them; None where there is none."""
        found = self._file.beside.pictures
        return found if found is not None and found.name == FOLDER else None

    def panorama(self, id: str) -> NDArray[np.uint8] | None:
        """(H, 2 H, 4) uint8, blue, green, red, 255, as the inspector shows it; None where there is none of it. Raises
        InputError when an image cannot be read."""
        found = self._file.panorama(id, PANORAMA_WIDTH)
        if found is None:
            return None
        return np.ascontiguousarray(np.dstack([found, np.full(found.shape[:2], 255, np.uint8)]))

    def context(self, known: Context) -> Context:
        own = self._file.context(known.limits, known.occupancy, known.against)
        return replace(own, floor=known.floor)
