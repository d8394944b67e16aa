"""Commands that select in the graph, the tables, the histogram, and the history."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nvsim.graph import selection as selecting
from nvsim.graph.edits import EditError
from nvsim.graph.offers import SelectionNeeds
from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import NavGraph
from nvsim_app.actions import Action
from nvsim_app.painting.cameras import OVER_WALLS, REACH, focused, view_along_edge
from nvsim_app.panels.histogram import HistogramPanel
from nvsim_app.panels.history import HistoryPanel
from nvsim_app.panels.tables import TablePanel
from nvsim_app.state.reasons import with_editing, with_selection
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.part import Dock, Part, WindowContext

_CHOSEN = with_selection(SelectionNeeds("things"), changes=False)


class SelectPart(Part):
    """Selects viewpoints and edges, and shows the selection."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        document = context.document
        self._editing = document.editing
        self.tables = TablePanel(document)
        self.histogram = HistogramPanel(document)
        self.history = HistoryPanel(document)
        self.tables.activated.connect(self.show_selection)
        self.tables.filter.returnPressed.connect(self._leave_expression)

    def docks(self) -> tuple[Dock, ...]:
        return (
            Dock("tables", "Viewpoints and edges", self.tables, "bottom", "jobs", needs=with_editing,
                 workspaces=("edit", "compare")),
            Dock("histogram", "Histogram", self.histogram, "bottom", "jobs", needs=with_editing, workspaces=("edit",)),
            Dock("history", "History", self.history, "left", "frames", needs=with_editing, workspaces=("edit",)),
        )  # fmt: skip

    def _select(self, how: Callable[[NavGraph, GraphSelection], GraphSelection]) -> None:
        graph = self._editing.graph
        if graph is None:
            return
        try:
            self._editing.select(how(graph, self._editing.selection))
        except EditError as error:
            self._editing.refuse(str(error))

    def _ask_expression(self) -> None:
        self.context.window.show_dock("tables")
        self.tables.filter.setFocus()
        self.tables.filter.selectAll()

    def _leave_expression(self) -> None:
        """Gives the keys to the view after Enter has selected, so that they act on the selection."""
        if self.tables.filter.text().strip() and self.tables.trouble.isHidden():
            self.context.scene.setFocus()

    def _select_visible(self, how: Callable[[NavGraph, GraphSelection], GraphSelection]) -> None:
        """Selects without the items on hidden storeys, because users cannot see what would happen to them."""

        def visible(graph: NavGraph, chosen: GraphSelection) -> GraphSelection:
            found, index = how(graph, chosen), self.context.document.shown_arrays.index
            edges = frozenset((a, b) for a, b in found.edges if a in index and b in index)
            return GraphSelection(found.viewpoints & index.keys(), edges)

        self._select(visible)

    def _path(self) -> None:
        self._select(lambda graph, chosen: selecting.path_between(graph, *sorted(chosen.viewpoints)))

    @staticmethod
    def _component(graph: NavGraph, chosen: GraphSelection) -> GraphSelection:
        return selecting.component(graph, chosen.viewpoints.union(*chosen.edges))

    def show_selection(self, chosen: GraphSelection) -> None:
        """Selects items, and shows them in the 3D view and in the center of the map."""
        self._editing.select(chosen)
        arrays = self.context.document.graph_arrays
        ends = [id for key in chosen.edges for id in key]
        rows = arrays.viewpoint_rows([*chosen.viewpoints, *ends])
        if not len(rows):
            return
        places = arrays.feet[rows]
        middle, size = (places.min(axis=0) + places.max(axis=0)) / 2, float(np.ptp(places, axis=0).max())
        scene = self.context.scene
        center = middle + [0.0, 0.0, 0.6]
        if len(rows) == 2 and len(chosen.edges) == 1 and self.context.document.contents.scene_stamp is not None:
            # Between walls, only a view along the edge is free of obstacles.
            scene.navigation.go_to(view_along_edge(scene.pose, arrays.positions[rows], arrays.feet[rows]))
        elif len(rows) == 1:
            scene.places.focus_on_point(center, REACH)
        else:
            above = replace(scene.pose, elevation=min(scene.pose.elevation, OVER_WALLS))
            scene.navigation.go_to(focused(above, center, max(REACH + 0.5, 1.4 * size)))
        plan = self.context.part(MapPart).view
        plan.center_on(float(middle[0]), float(middle[1]), max(4.0, 1.3 * size))

    ACTIONS = (
        Action("&Edit", 5, "select_all", "Select &all", "Select every viewpoint and edge",
               lambda self: self._select_visible(lambda graph, _: selecting.select_everything(graph)), "Ctrl+A",
               with_editing),
        Action("&Edit", 5, "select_none", "Select n&one", "Clear the selection",
               lambda self: self._editing.select(GraphSelection()), "Ctrl+Shift+A", _CHOSEN),
        Action("&Edit", 5, "invert", "In&vert selection", "Select everything that is not selected",
               lambda self: self._select_visible(selecting.inverted), "Ctrl+I", with_editing),
        Action("&Edit", 5, "grow", "&Grow selection", "Add the neighbors of the selection",
               lambda self: self._select(selecting.with_neighbors), "Ctrl++", _CHOSEN),
        Action("&Edit", 5, "component", "Select &component", "Select everything that can be reached from the selection",
               lambda self: self._select(self._component), "Ctrl+Shift+K", _CHOSEN),
        Action("&Edit", 5, "path", "Select pat&h between", "Select the shortest path of two viewpoints", _path,
               "Ctrl+Alt+P", with_selection(SelectionNeeds("viewpoints", 2, 2), changes=False)),
        Action("&Edit", 5, "select_expression", "Select by e&xpression…", "For example: degree > 4 and not reviewed",
               _ask_expression, "Ctrl+F", with_editing),
        Action("&Edit", 5, "select_range", "Select by &range…",
               "Select a range of a histogram: length, degree, evidence…",
               lambda self: self.context.window.show_dock("histogram"), enabled=with_editing),
        Action("&Edit", 6, "zoom_to", "&Zoom to selection",
               "Show the selection of the graph in the 3D view and on the map",
               lambda self: self.show_selection(self._editing.selection), "Z", _CHOSEN),
    )  # fmt: skip
