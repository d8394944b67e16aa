"""Undo and redo of view changes, both of the camera and of the settings of the view."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from PySide6.QtCore import QSettings, QTimer

from app.actions import Action
from app.drawing.renderer_choice import PREFERENCES
from app.look.plain_text import caption
from app.painting.tones import CHANNELS
from app.panels.preferences import BUDGETS
from app.state.document import Document
from app.state.reasons import Reason, with_positions
from app.state.view_states import ViewState, ViewStates, changes
from app.wiring.frames import FramePart
from app.wiring.part import Part, WindowContext

_RESTED = 450  # milliseconds without a movement until a camera pose is recorded


def can_go_back(document: Document) -> Reason:
    """None if a view change can be undone, otherwise the reason."""

    views = document.views
    there = views is not None and (views.before is not None or (views.pending and views.current is not None))
    return with_positions(document) or (None if there else "this is the first view")


def can_go_forward(document: Document) -> Reason:
    """None if a view change can be redone, otherwise the reason."""

    views = document.views
    return with_positions(document) or (None if views is not None and views.after else "this is the last view")


class ViewsPart(Part):
    """Records the views, and goes back and forward between them."""

    ACTIONS = (
        Action("view_back", "&Back", "Undo the last change of the view: camera, channel, layers, renderer", "&View", 4,
               "Alt+Left", enabled=can_go_back),
        Action("view_forward", "&Forward", "Redo the undone change of the view", "&View", 4, "Alt+Right",
               enabled=can_go_forward),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.states = context.document.views = ViewStates()
        self._showing = False  # true while this part restores a view
        self._rest = QTimer(self, singleShot=True, interval=_RESTED)
        self._rest.timeout.connect(self._on_rest)
        # All changes of one command, including a camera move, are one step.
        self._soon = QTimer(self, singleShot=True, interval=0)
        self._soon.timeout.connect(self._record)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"view_back": self.back, "view_forward": self.forward}

    def restore(self, settings: QSettings) -> None:
        scene, window = self.context.scene, self.context.window
        self._frames = self.context.part(FramePart)
        scene.poseChanged.connect(self._on_pose)
        scene.overlays.changed.connect(self._touch)
        window.centre.currentChanged.connect(self._touch)
        self._frames.browser.page.layers.changed.connect(self._touch)
        for id in (
            *CHANNELS,
            *(f"renderer_{name}" for name in PREFERENCES),
            *(f"budget_{count}" for count in BUDGETS),
            *(action.id for action in FramePart.ACTIONS if action.group),
        ):
            window.actions_table[id].triggered.connect(self._touch)
        self.context.document.projectChanged.connect(self._on_project)

    def store(self, settings: QSettings) -> None:
        self._rest.stop()
        self._soon.stop()

    # Back and forward ------------------------------------------------------------------------------------------

    def back(self) -> None:
        self._record()
        self._show(self.states.back())

    def forward(self) -> None:
        self._record()
        self._show(self.states.forward())

    def _show(self, state: ViewState | None) -> None:
        if state is None:
            return
        scene, table = self.context.scene, self.context.window.actions_table
        self._showing = True
        for name, (shown, opacity) in state.layers.items():
            if any(layer.name == name for layer in scene.overlays.layers):
                scene.overlays.set_shown(name, shown)
                scene.overlays.set_opacity(name, opacity)
        self._set_channel(state.channel)
        if scene.renderer != state.renderer:
            table[f"renderer_{state.renderer}"].trigger()
        if scene.budget != state.budget:
            table[f"budget_{state.budget}"].trigger()
        self._frames.show(state.page)
        if state.page.frame is None:
            scene.navigation.go_to(state.pose)
        else:
            scene.navigation.set_pose(state.pose)
        self._showing = False
        self._rest.stop()
        self._soon.stop()
        self.states.pending = False
        self.states.settle(self._read())
        self._say()

    def _set_channel(self, channel: str) -> None:
        self.context.window.actions_table[channel].setChecked(True)
        if self.context.scene.channel != channel:
            self.context.scene.set_channel(channel)

    def _touch(self, _: object = None) -> None:
        """Records a change other than a camera move."""
        if self._showing or self._soon.isActive():
            return
        if self._rest.isActive():
            self._rest.stop()
            self.states.record_pose(self.context.scene.navigation.goal, time.monotonic())
        self._soon.start()
        self._await()

    def _on_pose(self, _: object) -> None:
        if not self._showing:
            self._rest.start()
            self._await()

    def _await(self) -> None:
        """Enables Back before the change is recorded."""
        if not self.states.pending:
            self.states.pending = True
            self.context.window.actions_table.refresh()

    def _on_rest(self) -> None:
        if self.context.scene.navigation.active:
            self._rest.start()  # the user holds the camera still for a moment
        else:
            self._record()

    def _record(self) -> None:
        self._rest.stop()
        self._soon.stop()
        self.states.pending = False
        if len(self.context.document.extent):
            self.states.record(self._read(), time.monotonic())
        self._say()

    def _read(self) -> ViewState:
        scene = self.context.scene
        layers = {layer.name: (layer.shown, layer.opacity) for layer in scene.overlays.layers}
        pose = scene.navigation.goal
        return ViewState(pose, scene.channel, layers, scene.renderer, scene.budget, self._frames.shown)

    def _say(self) -> None:
        """Names the changes in the commands Back and Forward."""
        table, states = self.context.window.actions_table, self.states
        for id, title, way in (
            ("view_back", "&Back", (states.before, states.current)),
            ("view_forward", "&Forward", (states.current, states.after)),
        ):
            words = [] if None in way else list(changes(*way, self._title).values())  # type: ignore[arg-type]
            undone = words[0] + (f" and {len(words) - 1} more" if len(words) > 2 else "") if words else ""
            table[id].setText(f"{title}: {caption(undone)}" if undone else title)
        table.refresh()

    def _title(self, name: str) -> str:
        titles = {layer.name: layer.title for layer in self._frames.browser.layers}
        titles |= {layer.name: layer.title for layer in self.context.scene.overlays.layers}
        return titles.get(name, name)

    def _on_project(self) -> None:
        self._rest.stop()
        self._soon.stop()
        self.states.clear()
        self._say()
