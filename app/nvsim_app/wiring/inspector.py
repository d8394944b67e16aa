"""The viewpoint inspector: its panel, its regions of interest in the 3D view and on the map, and its panoramas."""

from __future__ import annotations

from functools import partial

import numpy as np
from PySide6.QtCore import QSettings

from nvsim.project.work import STAGE, sentence
from nvsim_app.actions import Action
from nvsim_app.inspector.layers import RegionLayer
from nvsim_app.inspector.panel import InspectorPanel
from nvsim_app.inspector.panoramas import Panoramas
from nvsim_app.inspector.state import Inspection
from nvsim_app.state.directions import Direction
from nvsim_app.state.document import Document
from nvsim_app.state.graph_files import ForeignGraph
from nvsim_app.state.reasons import Reason, with_editing, with_graph
from nvsim_app.wiring.part import Dock, Part, WindowContext


def with_viewpoint(document: Document) -> Reason:
    """None if a viewpoint is selected, otherwise the reason."""
    return with_graph(document) or (None if document.selected_viewpoint is not None else "no viewpoint is selected")


class InspectorPart(Part):
    """Shows the evidence of the selected viewpoint."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.inspection = Inspection(context.document, self)
        self.panoramas = Panoramas(context.scene.link, self)
        self.panel = InspectorPanel(self.inspection, self.panoramas)
        self._seen = self._only_in_front = False
        self.layer = RegionLayer(self.inspection)
        context.modes.beneath.append(self.layer.paint_on_map)
        self.panel.chosen.connect(self._go_in_direction)
        self.panel.view.walked.connect(self._walk_to)
        self.inspection.changed.connect(self._request_panorama)
        self.inspection.pointed.connect(context.modes.refresh)
        context.document.contentsChanged.connect(self._on_contents)
        context.document.unitsChanged.connect(self.inspection.changed)

    def docks(self) -> tuple[Dock, ...]:
        return (
            Dock("inspector", "Inspector", self.panel, "right", tab="details", needs=with_editing,
                 workspaces=("explore", "edit", "compare")),
        )  # fmt: skip

    def restore(self, settings: QSettings) -> None:
        overlays = self.context.scene.overlays
        if self.layer not in overlays.layers:
            overlays.add(self.layer)
            overlays.changed.connect(self._follow_layer)
            self._follow_layer()
        self.context.window.docks["inspector"].visibilityChanged.connect(self._on_seen)
        self.panel.set_channel(str(settings.value("inspector/channel", "rgb")))
        self.panel.regions.setChecked(settings.value("inspector/regions", "true") in (True, "true"))
        self._request_panorama()

    def store(self, settings: QSettings) -> None:
        self.panoramas.close()
        settings.setValue("inspector/channel", self.panel.view.channel)
        settings.setValue("inspector/regions", self.panel.regions.isChecked())

    def _on_seen(self, seen: bool) -> None:
        # To Qt, a panel behind another tab is visible, but this signal tells whether it can be seen.
        self._seen = seen
        self._draw_regions()
        self._request_panorama()

    def draw_only_in_front(self, on: bool) -> None:
        """If `on`, draws regions in the views only while the panel is in front, because the views follow an agent."""
        self._only_in_front = on
        self._draw_regions()

    def _draw_regions(self) -> None:
        self.layer.suppressed = not self._seen and self._only_in_front
        self.context.modes.refresh()

    def show_panel(self) -> None:
        """Brings the panel to the front."""
        self.context.window.show_dock("inspector")

    def _show_regions(self, on: bool) -> None:
        self.context.scene.overlays.set_shown(self.layer.name, on)

    def _follow_layer(self) -> None:
        """Updates the command after any change of the layer."""
        self.context.window.actions_table["show_rois"].setChecked(self.layer.shown)

    def _on_contents(self, parts: frozenset[str]) -> None:
        opened = "graph" in parts and isinstance(self.context.document.contents.graph_file, ForeignGraph)
        if "scene_stamp" in parts or opened:
            self.panoramas.clear_caches()
            self._request_panorama()

    def _request_panorama(self) -> None:
        """Requests the panorama while the panel is visible."""
        contents, id = self.context.document.contents, self.inspection.viewpoint
        file = contents.graph_file if isinstance(contents.graph_file, ForeignGraph) else None
        there = contents.scene_stamp is not None or (file is not None and file.pictured)
        x, y, z = (round(float(v), 4) for v in self.inspection.eye)
        if id is None or not there or not self._seen:
            self.panoramas.request(None)
        else:
            self.panoramas.request((x, y, z), None if file is None else partial(file.panorama, id))
        self.panel.enable_channels(file is None)
        lacking = f"{STAGE['train'].missing}, so there is nothing to show"
        lacking = "The folder of the file has no images." if file else sentence(lacking)
        self.panel.view.hint = "" if there else lacking
        self.panel.view.update()
        self.context.modes.refresh()

    def _walk_to(self, id: str) -> None:
        """Goes to a neighbor, and looks in the direction of the move."""
        document = self.context.document
        row = document.graph_arrays.index.get(id)
        if row is not None:
            way = document.graph_arrays.positions[row] - self.inspection.eye
            document.select(viewpoint=id)
            self.context.scene.places.go_to_position(
                document.graph_arrays.positions[row], float(np.arctan2(way[0], way[1]))
            )

    def _go_in_direction(self, direction: Direction) -> None:
        """Goes to the viewpoint in this direction, and looks ahead. If there is none, a notice gives the reason."""
        document = self.context.document
        row = document.graph_arrays.index.get(direction.neighbor)
        if row is None:
            self.context.notices.info(direction.sentence)
            return
        place: np.ndarray = document.graph_arrays.positions[row]
        heading = direction.evidence.heading
        document.select(viewpoint=direction.neighbor)
        self.context.scene.places.go_to_position(place, heading)
        self.panel.view.set_heading(heading)

    ACTIONS = (
        Action("&Graph", 9, "inspect", "&Inspect viewpoint",
               "Show the panorama of the selected viewpoint, and why each direction is open or blocked", show_panel,
               "I", with_viewpoint, icon="inspect"),
        Action("&View", 1, "show_rois", "&Regions of interest",
               "Show the regions of interest that decide the directions of the selected viewpoint", _show_regions, "R",
               with_graph, check="on"),
    )  # fmt: skip
