"""The frames of the walk: their list, and one of them beside the render from its camera."""

from __future__ import annotations

from PySide6.QtCore import QSettings

from app.frames.link import FrameLink
from app.frames.state import FrameState
from app.panels.frames import FramePanel
from app.parts.part import Dock, Part, Workspace


class FramePart(Part):
    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self._link = FrameLink(self)
        self.state = FrameState(workspace.document, self._link, self)
        self.panel = FramePanel(workspace.document, self._link, self.state)
        self.panel.opened.connect(self._open)

    def docks(self) -> tuple[Dock, ...]:
        return (Dock("frames", "Frames", self.panel, "left"),)

    def store(self, settings: QSettings) -> None:
        self._link.rest()

    def _open(self, frame: int) -> None:
        self.workspace.document.select(frame=frame)
        self.workspace.scene.snap_to_frame(frame)
