"""The source and target of an edited graph: the database of a project, or a connectivity file. Does not use Qt."""

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
from nvsim.graph.foreign import ForeignFile, saving_message
from nvsim.graph.journal import sidecar
from nvsim.graph.skybox_files import FOLDER
from nvsim.graph.types import NavGraph

PANORAMA_WIDTH = 1536  # pixels


class GraphFile(Protocol):
    """The storage of an edited graph.

    foreign   whether it is a graph file instead of a part of a project
    journal   path of the journal of its edits, None if there is none
    """

    @property
    def name(self) -> str: ...
    @property
    def foreign(self) -> bool: ...
    @property
    def journal(self) -> Path | None: ...
    def save(self, graph: NavGraph) -> str:
        """Writes the graph. Returns a notice for the user, "" for none. Raises InputError if it cannot be written."""
        ...

    def visibility(self, unknown: bool = True) -> Visible | None:
        """The visibility between viewpoints from the lists of the file, with `unknown` for pairs that are not listed.
        None if there are no lists."""
        ...

    def context(self, known: Context) -> Context:
        """The context of the validation: `known` with the additions of the file."""
        ...


class ProjectGraph:
    """The graph in the database of a project."""

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

    def visibility(self, unknown: bool = True) -> Visible | None:
        return None

    def context(self, known: Context) -> Context:
        return known


class ForeignGraph:
    """A connectivity file. Parts that are not edited are written back unchanged. `scans` are the files of its
    folder."""

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
        return saving_message(path, self._file.original, graph)

    def save_copy(self, graph: NavGraph, path: Path) -> None:
        """Writes `graph` to another file. Raises InputError if it cannot be written."""
        copy.copy(self._file).save(graph, path)

    def export(self, graph: NavGraph, folder: Path) -> Path:
        """Writes `graph` under its file name into another folder, and returns the file. Raises InputError if `folder`
        is the folder of the open file, or if the file cannot be written."""
        path = folder / self.path.name
        if path.resolve() == self.path.resolve():
            raise InputError(f"{path} is the open file; save it, or choose another folder.")
        self.save_copy(graph, path)
        return path

    def visibility(self, unknown: bool = True) -> Visible | None:
        return self._file.visibility(unknown)

    @property
    def pictured(self) -> bool:
        """Whether there are images of viewpoints beside the file."""
        return self._file.nearby_files.pictures is not None

    @property
    def path(self) -> Path:
        return self._file.path

    @property
    def skyboxes(self) -> Path | None:
        """The folder of skyboxes beside the file, in the layout of Matterport3DSimulator; None if there is none."""
        found = self._file.nearby_files.pictures
        return found if found is not None and found.name == FOLDER else None

    def panorama(self, id: str) -> NDArray[np.uint8] | None:
        """The panorama of a viewpoint, (H, 2 H, 4) uint8 (blue, green, red, 255); None if there is none. Raises
        InputError if an image cannot be read."""
        found = self._file.panorama(id, PANORAMA_WIDTH)
        if found is None:
            return None
        return np.ascontiguousarray(np.dstack([found, np.full(found.shape[:2], 255, np.uint8)]))

    def context(self, known: Context) -> Context:
        own = self._file.context(known.limits, known.occupancy, known.against)
        return replace(own, floor=known.floor)
