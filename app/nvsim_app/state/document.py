"""The document of the window: the contents of the project, the edited graph, the selection, and the storey that the
views show. Views only display it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, Signal

from nvsim.geometry.storeys import Storey, storeys
from nvsim.graph.clearness_cache import ClearnessCache
from nvsim.graph.difference import Difference
from nvsim.graph.findings import Context, Limits
from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.mapping.explanation.explain import closed_edge_reason, closed_path_test
from nvsim_app.jobs.queue import JobQueue
from nvsim_app.state.editing import Editing
from nvsim_app.state.graph_arrays import GraphArrays, GraphChanges, TrajectoryArrays
from nvsim_app.state.loading import CONTENT_PARTS, Contents
from nvsim_app.state.view_states import ViewStates


class Storeys(QObject):
    """The storeys of the graph. changed(): the storeys changed, or another one is displayed."""

    changed = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.found: tuple[Storey, ...] = ()
        self.chosen: int | None = None
        """Index in `found` of the displayed storey; None displays all."""
        self.others_faded = True
        """Whether the other storeys are drawn faintly."""
        self._of: GraphArrays | None = None
        self._beside: tuple[object, object, GraphArrays] = (None, None, GraphArrays())
        self._shown = GraphArrays()

    def update(self, arrays: GraphArrays, *, anew: bool = False) -> None:
        """Updates the storeys after a change of the graph. The displayed storey is kept if there is still one at its
        height, unless `anew`."""
        before, was = self.storey, (self.found, self.chosen)
        self.found = storeys(arrays.feet[:, 2])
        near = [i for i, s in enumerate(self.found) if before is not None and abs(s.floor - before.floor) < 1.0]
        self.chosen = near[0] if near and not anew and len(self.found) > 1 else None
        if self.storey != before:
            self._of = None
        if (self.found, self.chosen) != was:
            self.changed.emit()

    @property
    def storey(self) -> Storey | None:
        return None if self.chosen is None else self.found[self.chosen]

    @property
    def height_range(self) -> tuple[float, float] | None:
        """The minimum and maximum height of the displayed storey in meters, world; None if all are displayed."""
        storey = self.storey
        return None if storey is None else (storey.low, storey.high)

    def choose(self, index: int | None) -> None:
        """Displays one storey; None displays all."""
        if index != self.chosen and (index is None or 0 <= index < len(self.found)):
            self.chosen, self._of = index, None
            self.changed.emit()

    def step(self, by: int) -> None:
        """Moves up or down by storeys. If all are displayed, starts at the lowest or the highest."""
        first = 0 if by > 0 else len(self.found) - 1
        self.choose(first if self.chosen is None else min(max(self.chosen + by, 0), len(self.found) - 1))

    def show_storey_of(self, arrays: GraphArrays, ids: frozenset[str]) -> None:
        """Displays the storey of the selected viewpoints `ids` if none of them is displayed. If they are on several
        storeys, displays all."""
        if self.chosen is None or not ids:
            return
        floors = arrays.feet[arrays.viewpoint_rows(ids), 2]
        if len(floors) and not self.found[self.chosen].contains_floors(floors).any():
            holding = [i for i, s in enumerate(self.found) if s.contains_floors(floors).all()]
            self.choose(holding[0] if holding else None)

    def shown(self, arrays: GraphArrays) -> GraphArrays:
        """The displayed part of `arrays`; `arrays` itself if all storeys are displayed."""
        storey = self.storey
        if storey is None:
            return arrays
        if self._of is not arrays:
            self._of, self._shown = arrays, _select_viewpoints(arrays, storey.contains_floors(arrays.feet[:, 2]))
        return self._shown

    def fade_others(self, on: bool) -> None:
        if on != self.others_faded:
            self.others_faded = on
            self.changed.emit()

    def other_storeys(self, arrays: GraphArrays) -> GraphArrays:
        """The part of `arrays` that is drawn faintly and cannot be picked with the mouse."""
        storey = self.storey
        if storey is None or not self.others_faded:
            return GraphArrays()
        if self._beside[0] is not arrays or self._beside[1] is not storey:
            self._beside = arrays, storey, _select_viewpoints(arrays, ~storey.contains_floors(arrays.feet[:, 2]))
        return self._beside[2]


def _select_viewpoints(arrays: GraphArrays, keep: np.ndarray) -> GraphArrays:
    rows = np.flatnonzero(keep)
    ids = tuple(arrays.ids[row] for row in rows)
    moved_to = np.cumsum(keep) - 1
    return replace(
        arrays,
        ids=ids,
        positions=arrays.positions[rows],
        feet=arrays.feet[rows],
        edges=moved_to[arrays.edges[keep[arrays.edges].all(axis=1)]],
        submaps=arrays.submaps[rows],
        included=arrays.included[rows],
        index={id: i for i, id in enumerate(ids)},
    )


@dataclass(frozen=True)
class Selection:
    """The selected object, at most one: a viewpoint id, the index of a frame, or the index of a submap."""

    viewpoint: str | None = None
    frame: int | None = None
    submap: int | None = None

    def __bool__(self) -> bool:
        return self != Selection()


class Document(QObject):
    """The document that all views display.

    projectLeft()                another project is opened; the data of the old project is still available
    projectChanged()             another project was opened; `contentsChanged` follows
    contentsChanged(frozenset)   the changed names of loading.CONTENT_PARTS; "graph" if another graph was opened
    graphChanged(Difference)     an edit, an undo, or a redo
    selectionChanged()
    pageChanged()                another frame page, or none, is shown instead of the 3D view
    unitsChanged()               lengths must be displayed in another unit
    """

    projectLeft = Signal()
    projectChanged = Signal()
    contentsChanged = Signal(object)
    graphChanged = Signal(object)
    selectionChanged = Signal()
    pageChanged = Signal()
    unitsChanged = Signal()

    def __init__(self, path: Path | None = None, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._contents = Contents(path)
        self._selection = Selection()
        self.jobs: JobQueue | None = None  # jobs of the open project, if a window shows them
        self.views: ViewStates | None = None  # history of views, if a window shows it
        self._page_frame: int | None = None
        self.graph_arrays = GraphArrays()
        self.graph_changes = GraphChanges()
        self.storeys = Storeys(self)
        self.evidence = ClearnessCache()
        self.trajectory = TrajectoryArrays()
        self.editing = Editing(self)
        self._following = False  # whether one selection is currently updated from the other
        self.editing.graphChanged.connect(self._on_edit)
        self.editing.selectionChanged.connect(self._follow_editing)

    @property
    def contents(self) -> Contents:
        return self._contents

    @property
    def path(self) -> Path | None:
        return self._contents.path

    @property
    def project(self) -> Path | None:
        """The folder of the open project; None for a splat file and for a graph file."""
        file = self._contents.graph_file
        if self._contents.outline is not None or (file is not None and file.foreign):
            return None
        return None if self.path and self.path.is_file() else self.path

    @property
    def graph(self) -> NavGraph | None:
        """The edited graph, which views show. It may differ from the stored graph of the project."""
        return self.editing.graph

    @property
    def shown_arrays(self) -> GraphArrays:
        """The arrays of the displayed storey, which views draw and the mouse can pick; `graph_arrays` itself if all
        storeys are displayed."""
        return self.storeys.shown(self.graph_arrays)

    @property
    def selection(self) -> Selection:
        """The object whose details are shown. `editing.selection` contains multiple selected viewpoints or edges."""
        return self._selection

    def set_contents(self, contents: Contents) -> None:
        """Replaces the contents, and emits which parts changed. Parts are compared by identity."""
        if self._contents.path not in (None, contents.path):
            self.projectLeft.emit()
        before, self._contents = self._contents, contents
        changed = frozenset(part for part in CONTENT_PARTS if getattr(before, part) is not getattr(contents, part))
        if changed & {"capture", "submaps"}:
            self.trajectory = TrajectoryArrays.of(contents.capture, contents.submaps)
        restored = False  # whether a selection came back with unsaved edits
        if "graph" in changed or before.path != contents.path:
            if before.path != contents.path:
                self._selection = Selection()
            self._following = True  # the selection is updated below
            again = self.editing.history
            self.editing.open(contents.graph, contents.graph_file)
            self._following = False
            restored = self.editing.history is not again and bool(self.editing.selection)
            ready = contents.arrays if self.graph is contents.arrays_of else None
            self.graph_arrays = GraphArrays.of(self.graph) if ready is None else ready
            self.graph_changes.clear()
            self.storeys.update(self.graph_arrays, anew=before.path != contents.path)
            self.evidence.update(self.graph)
        if changed & {"graph", "occupancy", "capture", "context"}:
            self.editing.set_thresholds(contents.thresholds)
            self.editing.set_surroundings(contents.occupancy, self.trajectory.positions)
            known = contents.context
            if known is None or known.occupancy is not contents.occupancy:
                known = Context(
                    Limits(),
                    contents.occupancy,
                    closed_edge_reason(contents.thresholds),
                    closed_path_test(contents.thresholds),
                )
            self.editing.checking.set_context(known)
        if before.path != contents.path:
            self._selection = Selection()
            self.projectChanged.emit()
            self.selectionChanged.emit()
        if not changed:
            return
        if restored:
            self._selection = self._chosen()
        gone = not self._is_selectable(self._selection)
        if gone:  # before receivers use the selection
            self._selection = Selection()
        self.contentsChanged.emit(changed)
        if gone or restored:
            self.selectionChanged.emit()

    def select(self, *, viewpoint: str | None = None, frame: int | None = None, submap: int | None = None) -> None:
        """Selects one object, or nothing."""
        wanted = Selection(viewpoint, frame, submap)
        if wanted != self._selection and self._is_selectable(wanted):
            self._selection = wanted
            self.storeys.show_storey_of(self.graph_arrays, frozenset({wanted.viewpoint} if wanted.viewpoint else ()))
            self._lead_editing()
            self.selectionChanged.emit()
        elif wanted == self._selection and self.editing.selection:
            self._lead_editing()
            self.selectionChanged.emit()

    @property
    def page_frame(self) -> int | None:
        """Index of the frame whose page is shown instead of the 3D view, None if the 3D view is shown."""
        return self._page_frame

    def set_page_frame(self, index: int | None) -> None:
        """Sets the frame whose page is shown. Commands on frames depend on it."""
        if index != self._page_frame:
            self._page_frame = index
            self.pageChanged.emit()

    @property
    def frame_at_hand(self) -> int | None:
        """The frame that commands on frames use: the selected frame, else the frame of the page."""
        return self._selection.frame if self._selection.frame is not None else self._page_frame

    def _lead_editing(self) -> None:
        """Updates the selection of the editor from the selection of the document."""
        if self._following:
            return
        id = self._selection.viewpoint
        self._following = True
        self.editing.select(GraphSelection(frozenset() if id is None else frozenset({id})))
        self._following = False

    def _follow_editing(self) -> None:
        """Updates the selection of the document from the selection of the editor: a single viewpoint, else nothing."""
        if self._following:
            return
        chosen = self.editing.selection
        self.storeys.show_storey_of(self.graph_arrays, chosen.viewpoints.union(*chosen.edges))
        if chosen.viewpoints or chosen.edges or self._selection.viewpoint is not None:
            self._selection = self._chosen()
        self.selectionChanged.emit()

    def _chosen(self) -> Selection:
        """The viewpoint that is selected alone in the editor, else nothing."""
        chosen = self.editing.selection
        one = next(iter(chosen.viewpoints)) if len(chosen.viewpoints) == 1 and not chosen.edges else None
        return Selection(viewpoint=one if one in self.graph_arrays.index else None)

    def _on_edit(self, change: Difference) -> None:
        graph, before = self.graph, self.graph_arrays
        self.graph_arrays = GraphArrays() if graph is None else before.updated(graph, change)
        self.graph_changes.note(before, self.graph_arrays, change)
        if change.added_viewpoints or change.removed_viewpoints or change.changed_viewpoints:
            self.storeys.update(self.graph_arrays)
        self.evidence.update(graph)
        if not self._is_selectable(self._selection):
            self._selection = Selection()
        self.graphChanged.emit(change)

    def _is_selectable(self, selection: Selection) -> bool:
        if selection.viewpoint is not None:
            return selection.viewpoint in self.graph_arrays.index
        if selection.frame is not None:
            return 0 <= selection.frame < len(self.trajectory.positions)
        if selection.submap is not None:
            return any(s.index == selection.submap for s in self._contents.submaps)
        return True

    @property
    def selected_viewpoint(self) -> Viewpoint | None:
        graph, id = self.graph, self._selection.viewpoint
        return None if graph is None or id is None else graph.viewpoints.get(id)

    @property
    def selected_point(self) -> NDArray[np.float64] | None:
        """(3,) meters, world: the position of the selected object; the mean position of a submap."""
        viewpoint = self.selected_viewpoint
        if viewpoint is not None:
            return np.array(viewpoint.position)
        if self._selection.frame is not None:
            return self.trajectory.positions[self._selection.frame]
        for submap in self._contents.submaps:
            if submap.index == self._selection.submap:
                return submap.positions.mean(axis=0)
        return None

    @property
    def drawn_trajectory(self) -> TrajectoryArrays:
        """The trajectory of the capture. While there is no capture, the known part of a video's trajectory."""
        growing = self._contents.growing
        return self.trajectory if growing is None or self._contents.capture is not None else growing

    @property
    def extent(self) -> NDArray[np.float64]:
        """(N, 3) all known positions in meters, world: viewpoints, frames (also of a video whose poses are being
        computed), places of a project from splat files, and the outline of a splat file. May be empty."""
        outline, capture = self._contents.outline, self._contents.capture
        places = None if capture is None else capture.places
        known = [self.graph_arrays.positions, self.drawn_trajectory.positions]
        return np.concatenate([*known, *(some for some in (places, outline) if some is not None)])
