"""Undo and redo of view changes, and the last view of a project, which is restored when it is opened again."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QSettings, QTimer

from nvsim_app.actions import Action
from nvsim_app.drawing.renderer_choice import PREFERENCES
from nvsim_app.look.plain_text import caption
from nvsim_app.painting.value_colors import CHANNELS
from nvsim_app.panels.preferences import BUDGETS
from nvsim_app.state.document import Document, Selection
from nvsim_app.state.reasons import Reason, with_positions
from nvsim_app.state.view_state_store import StoredViewState, decode, encode
from nvsim_app.state.view_states import ViewState, ViewStates, changes
from nvsim_app.wiring.camera_path import CameraPathPart
from nvsim_app.wiring.frames import FramePart
from nvsim_app.wiring.inspector import InspectorPart
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.part import Part, WindowContext

_RESTED = 450  # milliseconds without a movement until a camera pose is recorded


def can_go_back(document: Document) -> Reason:
    """None if a view change can be undone, otherwise the reason."""

    views = document.views
    there = views is not None and (views.previous is not None or (views.pending and views.current is not None))
    return with_positions(document) or (None if there else "this is the first view")


def can_go_forward(document: Document) -> Reason:
    """None if a view change can be redone, otherwise the reason."""

    views = document.views
    return with_positions(document) or (None if views is not None and views.next else "this is the last view")


class ViewsPart(Part):
    """Records the views, and goes back and forward between them."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.states = context.document.views = ViewStates()
        self._showing = False  # true while this part restores a view
        self._rest = QTimer(self, singleShot=True, interval=_RESTED)
        self._rest.timeout.connect(self._on_rest)
        # All changes of one command, including a camera move, are one step.
        self._soon = QTimer(self, singleShot=True, interval=0)
        self._soon.timeout.connect(self._record)

    def restore(self, settings: QSettings) -> None:
        scene, window = self.context.scene, self.context.window
        self._frames = self.context.part(FramePart)
        scene.poseChanged.connect(self._on_pose)
        scene.overlays.changed.connect(self._on_changed)
        window.center.currentChanged.connect(self._on_changed)
        self._frames.browser.page.layers.changed.connect(self._on_changed)
        for id in (
            *CHANNELS,
            *(f"renderer_{name}" for name in PREFERENCES),
            *(f"budget_{count}" for count in BUDGETS),
            *(action.id for action in FramePart.ACTIONS if action.group),
        ):
            window.actions_table[id].triggered.connect(self._on_changed)
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
        if scene.feed.renderer != state.renderer:
            table[f"renderer_{state.renderer}"].trigger()
        if scene.feed.budget != state.budget:
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
        self.states.replace_current(self._read())
        self._name_changes()

    def _set_channel(self, channel: str) -> None:
        self.context.window.actions_table[channel].setChecked(True)
        if self.context.scene.feed.channel != channel:
            self.context.scene.set_channel(channel)

    def _on_changed(self, _: object = None) -> None:
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
        self._name_changes()

    def _read(self) -> ViewState:
        scene = self.context.scene
        layers = {layer.name: (layer.shown, layer.opacity) for layer in scene.overlays.layers}
        pose = scene.navigation.goal
        return ViewState(pose, scene.feed.channel, layers, scene.feed.renderer, scene.feed.budget, self._frames.shown)

    def _name_changes(self) -> None:
        """Names the changes in the commands Back and Forward."""
        table, states = self.context.window.actions_table, self.states
        for id, title, way in (
            ("view_back", "&Back", (states.previous, states.current)),
            ("view_forward", "&Forward", (states.current, states.next)),
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
        self._name_changes()

    ACTIONS = (
        Action("&View", 4, "view_back", "&Back", "Undo the last change of the view: camera, channel, layers, renderer",
               back, "Alt+Left", can_go_back),
        Action("&View", 4, "view_forward", "&Forward", "Redo the undone change of the view", forward, "Alt+Right",
               can_go_forward),
    )  # fmt: skip


_PREFIX = "views/"
OPEN = "open"
"""The settings key of the open file, for the next window."""


class ViewRestorePart(Part):
    """Stores and restores the view of each project or file."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._path: Path | None = context.document.path
        self._moved = False  # until the camera is placed, there is nothing to store
        self._last = Selection()
        self._wanted = StoredViewState()  # applied after the project is read

    def restore(self, settings: QSettings) -> None:
        document = self.context.document
        self._frames = self.context.part(FramePart)
        self._camera_path = self.context.part(CameraPathPart)
        self._map = self.context.part(MapPart).view
        self._inspector = self.context.part(InspectorPart).panel
        self.context.scene.poseChanged.connect(self._on_pose)
        document.projectLeft.connect(self._keep)
        document.projectChanged.connect(self._on_project)
        document.selectionChanged.connect(self._on_selection)
        document.contentsChanged.connect(self._on_contents)
        self._bring_back()

    def store(self, settings: QSettings) -> None:
        self._keep()
        settings.setValue(OPEN, "" if self._path is None else str(self._path.absolute()))

    def _key(self, path: Path) -> str:
        return _PREFIX + str(path.absolute()).replace("/", "|").replace("\\", "|")

    def _keep(self) -> None:
        if self._path is None or not self._moved:
            return
        scene = self.context.scene
        frame = self._frames.shown.frame if self._wanted.frame is None else self._wanted.frame
        left = StoredViewState(
            scene.navigation.goal,
            scene.feed.channel,
            self._last or self._wanted.selection,
            frame,
            self._map.visible_range,
            self._inspector.view.view_center,
            tuple(self._camera_path.poses),
        )
        self.context.settings.setValue(self._key(self._path), encode(left))

    def _on_project(self) -> None:
        self._path, self._moved = self.context.document.path, False
        self._bring_back()

    def _bring_back(self) -> None:
        self._last, self._wanted = Selection(), StoredViewState()
        kept = None
        if self._path is not None:
            kept = decode(str(self.context.settings.value(self._key(self._path), "")))
        if kept is None:
            return
        scene, self._wanted = self.context.scene, kept
        if kept.pose is not None:
            scene.stay_at(kept.pose)
            self._moved = True  # the camera has its stored place
        self.context.window.actions_table[kept.channel].setChecked(True)
        if scene.feed.channel != kept.channel:
            scene.set_channel(kept.channel)
        if kept.map_range is not None:
            self._map.restore_range(*kept.map_range)
        if kept.panorama is not None:
            self._inspector.view.set_view_center(*kept.panorama)
        self._camera_path.keep(kept.keys)
        self._on_contents(frozenset({"capture"}))

    def _on_contents(self, parts: frozenset[str]) -> None:
        """Restores the selection and the frame as soon as they are loaded."""
        wanted, document = self._wanted, self.context.document
        chosen, capture = wanted.selection, document.contents.capture
        if wanted.frame is not None and capture is not None:
            if 0 <= wanted.frame < len(capture.frames):
                self._frames.browser.open(wanted.frame)
                document.select()  # opening a frame selects it
                if wanted.pose is not None:
                    self.context.scene.stay_at(wanted.pose)
            self._wanted = replace(wanted, frame=None)
        if chosen and not document.selection:
            document.select(viewpoint=chosen.viewpoint, frame=chosen.frame, submap=chosen.submap)

    def _on_pose(self, _: object) -> None:
        self._moved = True

    def _on_selection(self) -> None:
        document = self.context.document
        if document.path == self._path:
            if document.selection or self._last:
                # A user, or this part, changed the selection, so the stored selection does not apply.
                self._wanted = replace(self._wanted, selection=Selection())
            self._last = document.selection
