"""What the window is put together from: a part is one capability with its commands, its docks and what it remembers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, TypeVar

from PySide6.QtCore import QObject, QSettings
from PySide6.QtWidgets import QWidget

from app.actions import Action
from app.jobs.queue import JobQueue
from app.look.notices import Notices
from app.panels.preferences import Preferences
from app.state.document import Document
from app.state.reasons import Reason, always

if TYPE_CHECKING:
    from app.modes.controller import ModeController
    from app.views.scene_view import SceneView
    from app.wiring.window import MainWindow

AnyPart = TypeVar("AnyPart", bound="Part")


@dataclass(frozen=True)
class Dock:
    """A panel at the rim of the window.

    name    its key in the stored layout and in `MainWindow.panels`
    area    the side it stands on, below what stands there already
    tab     name of the dock it shares its place with, "" for a place of its own
    width, height   pixels that it has at first where there is room, 0 for whatever is left
    needs    why it has nothing to say of what is open, None where it has; it is closed while it has nothing to say
    """

    name: str
    title: str
    widget: QWidget
    area: Literal["left", "right", "bottom"]
    tab: str = ""
    width: int = 0
    height: int = 0
    needs: Callable[[Document], Reason] = always


@dataclass(frozen=True)
class Workspace:
    """What every part may use. (What users call a workspace is an `arrangements.Arrangement`.)"""

    document: Document
    settings: QSettings
    notices: Notices
    scene: SceneView
    jobs: JobQueue  # what runs long goes through it
    modes: ModeController  # how the mouse edits the graph in both views
    window: MainWindow  # parent of dialogs
    preferences: Preferences  # what a user sets for all projects

    def part(self, kind: type[AnyPart]) -> AnyPart:
        """The part of that class, once every part is made. Raises LookupError while there is none."""
        return self.window.part(kind)


class Part(QObject):
    """Parts are made in the order of `app.wiring.PARTS`, after the 3D view and before the menus."""

    ACTIONS: ClassVar[tuple[Action, ...]] = ()

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace.window)
        self.workspace = workspace

    @classmethod
    def actions(cls) -> tuple[Action, ...]:
        """Its commands, asked for when a window is made."""
        return cls.ACTIONS

    def docks(self) -> tuple[Dock, ...]:
        """Its panels, asked for once."""
        return ()

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        """Action id -> what it does; a switch is called with its new state."""
        return {}

    def restore(self, settings: QSettings) -> None:
        """Restores what `store` wrote, once all parts are made. Any value may stand in `settings`."""

    def store(self, settings: QSettings) -> None:
        """Writes what the next window should show again; the window is about to close."""
