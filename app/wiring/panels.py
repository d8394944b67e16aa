"""The panels that only show the document: submaps, map, details, log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PySide6.QtCore import QSettings

from app.look.notices import Notice
from app.panels.details import DetailsPanel
from app.panels.log import LogPanel
from app.panels.submaps import SubmapPanel
from app.views.map_view import MapView
from app.wiring.part import Dock, Part, Workspace


class SubmapPart(Part):
    def docks(self) -> tuple[Dock, ...]:
        panel = SubmapPanel(self.workspace.document)
        panel.table.doubleClicked.connect(lambda _: self.workspace.scene.focus_on_selection())
        return (Dock("submaps", "Submaps", panel, "left", width=330, height=250),)


class MapPart(Part):
    """The map and the 3D view move each other's camera."""

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self.view = MapView(workspace.document)

    def docks(self) -> tuple[Dock, ...]:
        view = self.view
        self.workspace.scene.poseChanged.connect(view.show_pose)
        self.workspace.scene.hovered.connect(view.show_hovered)
        view.hovered.connect(self.workspace.scene.show_hovered)
        view.cameraDragged.connect(self._drag_camera)
        view.cameraPlaced.connect(self._place_camera)
        return (Dock("map", "Map", view, "right", width=380, height=380),)

    def _drag_camera(self, x: float, y: float) -> None:
        scene = self.workspace.scene
        scene.navigation.set_pose(replace(scene.pose, position=(x, y, scene.pose.position[2])))

    def _place_camera(self, x: float, y: float) -> None:
        extent = self.workspace.document.extent
        if len(extent):
            nearest = extent[np.argmin(np.hypot(extent[:, 0] - x, extent[:, 1] - y))]
            self.workspace.scene.go_to_position(np.array([x, y, nearest[2]]))


class DetailsPart(Part):
    def docks(self) -> tuple[Dock, ...]:
        return (Dock("details", "Details", DetailsPanel(self.workspace.document), "right", height=440),)


class LogPart(Part):
    def restore(self, settings: QSettings) -> None:
        self.workspace.window.notice_area.detailsWanted.connect(self._show)

    def _show(self, notice: Notice) -> None:
        self.workspace.window.show_dock("log")

    def docks(self) -> tuple[Dock, ...]:
        return (Dock("log", "Log", LogPanel(self.workspace.notices), "bottom", tab="jobs"),)
