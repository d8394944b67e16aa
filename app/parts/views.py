"""Back and forward between views; and a project opens as it was left: camera, selection, channel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from PySide6.QtCore import QSettings, QTimer

from app.actions import Action
from app.document import Selection
from app.parts.part import Part, Workspace
from app.reasons import with_positions
from app.tones import CHANNELS
from app.view_states import ViewState, ViewStates, decode, encode

_RESTED = 450  # milliseconds without a change until a view is one to go back to
_PREFIX = "views/"


class ViewsPart(Part):
    ACTIONS = (
        Action(
            "view_back",
            "View &before",
            "Go back to how the view was: where the eye stood, what was shown, which layers lay over it",
            "&Camera",
            2,
            "Alt+Left",
            enabled=with_positions,
        ),
        Action(
            "view_forward",
            "View a&fter",
            "Go forward again to a view that one went back from",
            "&Camera",
            2,
            "Alt+Right",
            enabled=with_positions,
        ),
    )

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self.states = ViewStates()
        self._path: Path | None = workspace.document.path
        self._moved = False
        self._last = Selection()
        self._wanted = Selection()
        self._rest = QTimer(self, singleShot=True, interval=_RESTED)
        self._rest.timeout.connect(self._record)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"view_back": self.back, "view_forward": self.forward}

    def restore(self, settings: QSettings) -> None:
        scene, document = self.workspace.scene, self.workspace.document
        scene.poseChanged.connect(self._on_pose)
        scene.overlays.changed.connect(self._touch)
        for channel in CHANNELS:
            self.workspace.window.actions_table[channel].triggered.connect(self._touch)
        document.projectChanged.connect(self._on_project)
        document.selectionChanged.connect(self._on_selection)
        document.contentsChanged.connect(self._on_contents)
        self._bring_back()

    def store(self, settings: QSettings) -> None:
        self._rest.stop()
        self._keep()

    # Back and forward ------------------------------------------------------------------------------------------

    def back(self) -> None:
        self._record()
        self._show(self.states.back(), "This is the first view.")

    def forward(self) -> None:
        self._show(self.states.forward(), "This is the last view.")

    def _show(self, state: ViewState | None, otherwise: str) -> None:
        if state is None:
            self.workspace.window.statusBar().showMessage(otherwise, 3000)
            return
        scene = self.workspace.scene
        for name, (shown, opacity) in state.layers.items():
            if any(layer.name == name for layer in scene.overlays.layers):
                scene.overlays.set_shown(name, shown)
                scene.overlays.set_opacity(name, opacity)
        self._set_channel(state.channel)
        scene.navigation.go_to(state.pose)
        self._rest.stop()

    def _set_channel(self, channel: str) -> None:
        self.workspace.window.actions_table[channel].setChecked(True)
        if self.workspace.scene.channel != channel:
            self.workspace.scene.set_channel(channel)

    def _touch(self) -> None:
        self._rest.start()

    def _on_pose(self, _: object) -> None:
        self._moved = True
        self._rest.start()

    def _record(self) -> None:
        scene = self.workspace.scene
        self._rest.stop()
        if len(self.workspace.document.extent):
            layers = {layer.name: (layer.shown, layer.opacity) for layer in scene.overlays.layers}
            self.states.record(ViewState(scene.pose, scene.channel, layers))

    # A project as it was left ----------------------------------------------------------------------------------

    def _key(self, path: Path) -> str:
        return _PREFIX + str(path.absolute()).replace("/", "|").replace("\\", "|")

    def _keep(self) -> None:
        """Of the project that is open, or just was."""
        if self._path is not None and self._moved:
            text = encode(self.workspace.scene.pose, self.workspace.scene.channel, self._last)
            self.workspace.settings.setValue(self._key(self._path), text)

    def _on_project(self) -> None:
        self._keep()
        self._path, self._moved = self.workspace.document.path, False
        self.states.clear()
        self._bring_back()

    def _bring_back(self) -> None:
        self._last = self._wanted = Selection()
        kept = None
        if self._path is not None:
            kept = decode(str(self.workspace.settings.value(self._key(self._path), "")))
        if kept is None:
            return
        pose, channel, self._wanted = kept
        if pose is not None:
            self.workspace.scene.navigation.set_pose(pose)
        self._set_channel(channel)
        self._select_wanted()

    def _on_contents(self, parts: frozenset[str]) -> None:
        self._select_wanted()

    def _select_wanted(self) -> None:
        """Selects what was selected, once it is there."""
        wanted, document = self._wanted, self.workspace.document
        if wanted and not document.selection:
            document.select(viewpoint=wanted.viewpoint, frame=wanted.frame, submap=wanted.submap)

    def _on_selection(self) -> None:
        document = self.workspace.document
        if document.path == self._path:
            self._last = document.selection
            if document.selection:
                self._wanted = Selection()  # a person, or this part, has chosen
