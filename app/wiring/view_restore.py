"""Restores the last view of a project: camera, channel, selection, frame in the center, visible part of the map,
direction of the inspector, and camera path."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QSettings

from app.state.document import Selection
from app.state.view_state_store import Left, decode, encode
from app.wiring.camera_path import CameraPathPart
from app.wiring.frames import FramePart
from app.wiring.inspector import InspectorPart
from app.wiring.panels import MapPart
from app.wiring.part import Part, WindowContext

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
        self._wanted = Left()  # applied after the project is read

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
        left = Left(
            scene.navigation.goal,
            scene.channel,
            self._last or self._wanted.selection,
            frame,
            self._map.seen,
            self._inspector.view.gaze,
            tuple(self._camera_path.poses),
        )
        self.context.settings.setValue(self._key(self._path), encode(left))

    def _on_project(self) -> None:
        self._path, self._moved = self.context.document.path, False
        self._bring_back()

    def _bring_back(self) -> None:
        self._last, self._wanted = Selection(), Left()
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
        if scene.channel != kept.channel:
            scene.set_channel(kept.channel)
        if kept.map_range is not None:
            self._map.see(*kept.map_range)
        if kept.panorama is not None:
            self._inspector.view.look(*kept.panorama)
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
