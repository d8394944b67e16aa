"""The layers over the 3D view: their panel, commands for the common layers, and their stored state."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

from PySide6.QtCore import QSettings

from app.actions import Action
from app.panels.layers import LayersPanel
from app.state.reasons import with_graph, with_occupancy, with_positions, with_trajectory
from app.wiring.part import Dock, Part, WindowContext

_PREFIX = "layers/"


class LayersPart(Part):
    """Shows and hides layers."""

    ACTIONS = (
        Action("show_graph", "&Graph", "Draw the navigation graph over the view", "&View", 1, "G", "graph", "on",
               toolbar=True, enabled=with_graph),
        Action("show_trajectory", "&Trajectory", "Draw the trajectory over the view, in the colors of its submaps",
               "&View", 1, "J", "trajectory", "on", toolbar=True, enabled=with_trajectory),
        Action("show_labels", "&Labels", "Show the ids of nearby viewpoints", "&View", 1, "L", "labels", "on",
               toolbar=True, enabled=with_graph),
        Action("show_occupancy", "&Occupancy on the floor",
               "Draw the occupancy map on the floor: green is free, red is occupied", "&View", 1, check="off",
               enabled=with_occupancy),
        Action("show_frusta", "Camera &frusta", "Draw the cameras of nearby frames", "&View", 1, check="off",
               enabled=with_trajectory),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._stand_in = ""  # layer that is shown because there is no reconstruction
        context.scene.overlays.changed.connect(self._follow)
        context.document.projectLeft.connect(self._hide_stand_in)
        context.document.contentsChanged.connect(self._on_contents)

    def docks(self) -> tuple[Dock, ...]:
        panel = LayersPanel(self.context.scene.overlays, self.context.document)
        return (
            Dock("layers", "Layers", panel, "left", tab="submaps", needs=with_positions,
                 workspaces=("explore", "edit", "compare")),
        )  # fmt: skip

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        overlays = self.context.scene.overlays
        return {action.id: partial(overlays.set_shown, action.id.removeprefix("show_")) for action in self.ACTIONS}

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

    def _follow(self) -> None:
        """Updates the commands after any change of the layers."""
        table = self.context.window.actions_table
        for action in self.ACTIONS:
            table[action.id].setChecked(self.context.scene.overlays[action.id.removeprefix("show_")].shown)
