"""The parts of the map, the submaps, the details, and the log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from PySide6.QtCore import QSettings

from app.actions import Action
from app.look.notices import Notice
from app.panels.details import DetailsPanel
from app.panels.log import LogPanel
from app.panels.submaps import SubmapPanel
from app.state.document import Document
from app.state.reasons import Reason, with_places, with_positions, with_trajectory
from app.views.map_view import MapView
from app.wiring.part import Dock, Part, WindowContext


class SubmapPart(Part):
    """The panel of submaps."""

    def docks(self) -> tuple[Dock, ...]:
        panel = SubmapPanel(self.context.document)
        panel.table.doubleClicked.connect(lambda _: self.context.scene.focus_on_selection())
        return (
            Dock("submaps", "Submaps", panel, "left", width=330, height=250, needs=with_trajectory,
                 workspaces=("explore", "train")),
        )  # fmt: skip


class MapPart(Part):
    """The map. The map and the 3D view move each other's camera."""

    ACTIONS = (
        Action("whole_map", "&Whole map", "Show trajectory, graph, and occupancy map completely on the map", "&View", 7,
               "Shift+O", "overview", enabled=with_positions),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.view = MapView(context.document)

    def docks(self) -> tuple[Dock, ...]:
        view = self.view
        self.context.scene.poseChanged.connect(view.show_pose)
        self.context.scene.hovered.connect(view.show_hovered)
        view.hovered.connect(self.context.scene.show_hovered)
        view.cameraDragged.connect(self._drag_camera)
        view.cameraPlaced.connect(self._place_camera)
        self.context.document.projectChanged.connect(self._forget_hovered)
        return (
            Dock("map", "Map", view, "right", width=380, height=380, needs=with_places,
                 workspaces=("explore", "train", "edit", "compare")),
        )  # fmt: skip

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"whole_map": self.view.show_whole}

    def restore(self, settings: QSettings) -> None:
        self.view.frame.take(self.context.window.actions_table["whole_map"])

    def _forget_hovered(self) -> None:
        self.view.show_hovered(None)
        self.context.scene.show_hovered(None)

    def _drag_camera(self, x: float, y: float) -> None:
        scene = self.context.scene
        scene.navigation.set_pose(replace(scene.pose, position=(x, y, scene.pose.position[2])))

    def _place_camera(self, x: float, y: float) -> None:
        extent = self.context.document.extent
        if len(extent):
            nearest = extent[np.argmin(np.hypot(extent[:, 0] - x, extent[:, 1] - y))]
            self.context.scene.go_to_position(np.array([x, y, nearest[2]]))


def with_details(document: Document) -> Reason:
    """None if something can be selected or a video has a report about its poses, otherwise the reason."""
    return None if document.contents.poses is not None else with_places(document)


class DetailsPart(Part):
    """The panel of details of the selection."""

    def docks(self) -> tuple[Dock, ...]:
        panel = DetailsPanel(self.context.document)
        return (Dock("details", "Details", panel, "right", height=440, needs=with_details,
                     workspaces=("explore", "train", "edit", "compare")),)  # fmt: skip


class LogPart(Part):
    """The panel of the log."""

    def restore(self, settings: QSettings) -> None:
        self.context.window.notice_area.detailsWanted.connect(self._show)

    def _show(self, notice: Notice) -> None:
        self.context.window.show_dock("log")

    def docks(self) -> tuple[Dock, ...]:
        return (Dock("log", "Log", LogPanel(self.context.notices), "bottom", tab="jobs", workspaces=("train",)),)
