"""The building blocks of the window: a part is one capability with its commands, docks, and stored settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, TypeVar

from PySide6.QtCore import QObject, QSettings
from PySide6.QtWidgets import QWidget

from nvsim_app.actions import Action
from nvsim_app.jobs.queue import JobQueue
from nvsim_app.look.notices import Notices
from nvsim_app.panels.preferences import Preferences
from nvsim_app.state.document import Document
from nvsim_app.state.reasons import Reason, never_disabled

if TYPE_CHECKING:
    from nvsim_app.modes.controller import ModeController
    from nvsim_app.views.scene_view import SceneView
    from nvsim_app.wiring.window import MainWindow

AnyPart = TypeVar("AnyPart", bound="Part")


@dataclass(frozen=True)
class Dock:
    """A panel at the edge of the window.

    name    its key in the stored layout and in `MainWindow.panels`
    area    side of the window; the dock is placed below the docks that are already there
    tab     name of the dock whose place it shares as a tab; "" for its own place
    width, height   default size in pixels, if there is room; 0 for the remaining room
    needs    reason why the panel does not apply to the open file, or None; with a reason, the panel is closed
    workspaces   ids of the workspaces that open the panel; a command or the Window menu opens it in the others
    """

    name: str
    title: str
    widget: QWidget
    area: Literal["left", "right", "bottom"]
    tab: str = ""
    width: int = 0
    height: int = 0
    needs: Callable[[Document], Reason] = never_disabled
    workspaces: tuple[str, ...] = ()


@dataclass(frozen=True)
class WindowContext:
    """The objects that every part may use."""

    document: Document
    settings: QSettings
    notices: Notices
    scene: SceneView
    jobs: JobQueue  # runs all long work
    modes: ModeController  # edits the graph with the mouse in both views
    window: MainWindow  # parent of dialogs
    preferences: Preferences  # settings for all projects

    def part(self, kind: type[AnyPart]) -> AnyPart:
        """The part of a class. Raises LookupError if it does not exist yet."""
        return self.window.part(kind)


class Part(QObject):
    """One capability of the window. Parts are created in the order of `nvsim_app.wiring.PARTS`, after the 3D view and
    before the menus."""

    ACTIONS: ClassVar[tuple[Action, ...]] = ()

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context.window)
        self.context = context

    @classmethod
    def actions(cls) -> tuple[Action, ...]:
        """The commands. Called when a window is created."""
        return cls.ACTIONS

    def docks(self) -> tuple[Dock, ...]:
        """The panels. Called once."""
        return ()

    def restore(self, settings: QSettings) -> None:
        """Restores the settings of `store`, after all parts exist. `settings` may contain any value."""

    def store(self, settings: QSettings) -> None:
        """Stores settings for the next window, before the window closes."""
