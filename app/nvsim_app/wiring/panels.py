"""Panels that show the state of the project: map, submaps, details, layers, results, networks, and the log."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from PySide6.QtCore import QSettings, Signal

from nvsim.project.work import EVALUATIONS
from nvsim_app.actions import Action
from nvsim_app.jobs.queue import JobHandle
from nvsim_app.look.notices import Notice
from nvsim_app.look.widgets import show_and_focus
from nvsim_app.panels.details import DetailsPanel
from nvsim_app.panels.layers import LayersPanel
from nvsim_app.panels.log import LogPanel
from nvsim_app.panels.models import InstalledModels, ModelsWindow
from nvsim_app.panels.results import ResultPanel
from nvsim_app.panels.submaps import SubmapPanel
from nvsim_app.state.document import Document
from nvsim_app.state.reasons import (
    Reason,
    with_graph,
    with_occupancy,
    with_places,
    with_positions,
    with_results,
    with_trajectory,
)
from nvsim_app.state.results import EvaluationResult, result_of_job, stored_result
from nvsim_app.views.map_view import MapView
from nvsim_app.wiring.part import Dock, Part, WindowContext


class SubmapPart(Part):
    """The panel of submaps."""

    def docks(self) -> tuple[Dock, ...]:
        panel = SubmapPanel(self.context.document)
        panel.table.doubleClicked.connect(lambda _: self.context.scene.places.focus_on_selection())
        return (
            Dock("submaps", "Submaps", panel, "left", width=330, height=250, needs=with_trajectory,
                 workspaces=("explore", "train")),
        )  # fmt: skip


class MapPart(Part):
    """The map. The map and the 3D view move each other's camera."""

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

    def restore(self, settings: QSettings) -> None:
        self.view.frame.set_action(self.context.window.actions_table["whole_map"])

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
            self.context.scene.places.go_to_position(np.array([x, y, nearest[2]]))

    ACTIONS = (
        Action("&View", 7, "whole_map", "&Whole map", "Show trajectory, graph, and occupancy map completely on the map",
               lambda self: self.view.show_whole(), "Shift+O", with_positions, icon="overview"),
    )  # fmt: skip


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


_PREFIX = "layers/"


def _set_shown(layer: str) -> Callable[[Part, bool], None]:
    return lambda part, on: part.context.scene.overlays.set_shown(layer, on)


class LayersPart(Part):
    """Shows and hides layers."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._stand_in = ""  # layer that is shown because there is no reconstruction
        context.scene.overlays.changed.connect(self._update_commands)
        context.document.projectLeft.connect(self._hide_stand_in)
        context.document.contentsChanged.connect(self._on_contents)

    def docks(self) -> tuple[Dock, ...]:
        panel = LayersPanel(self.context.scene.overlays, self.context.document)
        return (
            Dock("layers", "Layers", panel, "left", tab="submaps", needs=with_positions,
                 workspaces=("explore", "compare")),
        )  # fmt: skip

    def restore(self, settings: QSettings) -> None:
        state: dict[str, tuple[bool, float]] = {}
        settings.beginGroup(_PREFIX)
        for name in settings.childKeys():
            shown, _, opacity = str(settings.value(name)).partition(" ")
            try:
                value = float(opacity)
            except ValueError:
                continue  # the settings file has an invalid value
            if not math.isnan(value):
                state[name] = shown == "on", min(max(value, 0.0), 1.0)
        settings.endGroup()
        self.context.scene.overlays.remember(state)
        self._on_contents()

    def store(self, settings: QSettings) -> None:
        self._hide_stand_in()
        for name, (shown, opacity) in self.context.scene.overlays.state.items():
            settings.setValue(f"{_PREFIX}{name}", f"{'on' if shown else 'off'} {opacity:.2f}")

    def _on_contents(self, _: object = None) -> None:
        """Without a reconstruction, shows the point cloud, or the cameras if there is none."""
        contents, overlays = self.context.document.contents, self.context.scene.overlays
        wanted = ""
        untrained = contents.scene_stamp is None and bool(contents.stages) and "train" not in contents.stages
        if untrained and contents.capture is not None and contents.capture.frames:
            wanted = "frusta" if contents.scan_cloud is None else "cloud"
        if wanted == self._stand_in:
            return  # also after the user hid the layer
        self._hide_stand_in()
        if wanted and not overlays[wanted].shown:
            self._stand_in = wanted
            overlays.set_shown(wanted, True)

    def _hide_stand_in(self) -> None:
        stand_in, self._stand_in = self._stand_in, ""
        if stand_in:
            self.context.scene.overlays.set_shown(stand_in, False)

    def _update_commands(self) -> None:
        """Updates the commands after any change of the layers."""
        table = self.context.window.actions_table
        for action in self.ACTIONS:
            table[action.id].setChecked(self.context.scene.overlays[action.id.removeprefix("show_")].shown)

    ACTIONS = (
        Action("&View", 1, "show_graph", "&Graph", "Draw the navigation graph over the view", _set_shown("graph"), "G",
               with_graph, icon="graph", check="on", toolbar=True),
        Action("&View", 1, "show_trajectory", "&Trajectory",
               "Draw the trajectory over the view, in the colors of its submaps", _set_shown("trajectory"), "J",
               with_trajectory, icon="trajectory", check="on", toolbar=True),
        Action("&View", 1, "show_labels", "&Labels", "Show the ids of nearby viewpoints", _set_shown("labels"), "L",
               with_graph, icon="labels", check="on", toolbar=True),
        Action("&View", 1, "show_occupancy", "&Occupancy on the floor",
               "Draw the occupancy map on the floor: green is free, red is occupied", _set_shown("occupancy"),
               enabled=with_occupancy, check="off"),
        Action("&View", 1, "show_frusta", "Camera &frusta", "Draw the cameras of nearby frames", _set_shown("frusta"),
               enabled=with_trajectory, check="off"),
    )  # fmt: skip


class ResultPart(Part):
    """Collects and shows results. gathered(list of Result): all results."""

    gathered = Signal(object)

    def docks(self) -> tuple[Dock, ...]:
        w = self.context
        self.panel = ResultPanel(w.notices)
        self.panel.frameWanted.connect(self._go_to_frame)
        self.panel.submapWanted.connect(lambda index: w.document.select(submap=index))
        self._read: dict[int, EvaluationResult | None] = {}  # number of a finished job -> its result
        w.document.contentsChanged.connect(self._on_contents)
        w.document.projectChanged.connect(self._on_project)
        w.jobs.changed.connect(self._collect_results)
        w.jobs.ended.connect(self._on_ended)
        return (
            Dock("results", "Results", self.panel, "bottom", tab="jobs", needs=with_results,
                 workspaces=("train", "compare")),
        )  # fmt: skip

    def _on_project(self) -> None:
        self._read.clear()
        self._collect_results()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "results" in parts:
            self._collect_results()

    def _on_ended(self, handle: JobHandle) -> None:
        if handle.job.order.verb in EVALUATIONS and handle.state == "done":
            self._read.pop(handle.number, None)  # the job may have run again
            self._collect_results()
            self.context.window.front_dock("results")

    def _collect_results(self) -> None:
        found = []
        for handle in self.context.jobs.handles:
            if handle.state == "done":
                if handle.number not in self._read:
                    self._read[handle.number] = result_of_job(handle.job)
                found.append(self._read[handle.number])
        stored = self.context.document.contents.results
        fresh = [stored_result(name, at, figures) for name, (at, figures) in stored.items()]
        results = [r for r in (*found, *fresh) if r is not None]
        self.panel.show_results(results)
        self.gathered.emit(results)

    def _go_to_frame(self, frame: int) -> None:
        self.context.document.select(frame=frame)
        self.context.scene.places.snap_to_frame(frame)


class ModelsPart(Part):
    """Opens the window of networks."""

    def docks(self) -> tuple[Dock, ...]:
        self.models = InstalledModels(self)
        self.page: ModelsWindow | None = None
        return ()

    def store(self, settings: QSettings) -> None:
        self.models.stop()

    def open_page(self) -> ModelsWindow:
        """Shows the window. There is only one."""
        if self.page is None:
            self.page = ModelsWindow(self.models, self.context.window)
            self.page.destroyed.connect(self._close_window)
        self.models.list()
        show_and_focus(self.page)
        return self.page

    def _close_window(self) -> None:
        self.page = None
        self.models.stop()

    ACTIONS = (
        Action("&Jobs", 4, "models", "&Networks…",
               "Show the installed networks, their authors, and the networks that would improve results", open_page),
    )  # fmt: skip
