"""The interface of an editing mode: how it handles clicks and drags in a view of the graph.

A mode uses only the GraphSurface interface of a view, so it works both in the map and in the 3D view.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QKeyEvent, QPainter

from app.state.document import Document
from app.state.editing import Editing
from app.views.graph_surface import GraphSurface

_M = Qt.KeyboardModifier


@dataclass(frozen=True)
class Pointer:
    """The mouse pointer at one moment: the view, the position in its pixels, and the pressed modifier keys."""

    surface: GraphSurface
    point: QPointF
    modifiers: Qt.KeyboardModifier = _M.NoModifier

    @property
    def adds(self) -> bool:
        return bool(self.modifiers & _M.ShiftModifier)

    @property
    def toggles(self) -> bool:
        return bool(self.modifiers & _M.ControlModifier)

    @property
    def free(self) -> bool:
        """Whether snapping is off."""
        return bool(self.modifiers & _M.AltModifier)

    @property
    def viewpoint(self) -> str | None:
        return self.surface.pick_viewpoint(self.point)

    @property
    def edge(self) -> tuple[str, str] | None:
        return self.surface.pick_edge(self.point)


@dataclass(frozen=True)
class ModeContext:
    """The objects that every mode may use. `say` shows a text in the status bar; `refresh` repaints the views."""

    document: Document
    editing: Editing
    say: Callable[[str], None]
    refresh: Callable[[], None]


class Mode:
    """The base class. It handles nothing, so that the view handles the mouse itself."""

    name: ClassVar[str] = ""
    hint: ClassVar[str] = ""
    """The effect of the mouse, for the status bar."""
    cursor: ClassVar[Qt.CursorShape] = Qt.CursorShape.ArrowCursor
    needs_graph: ClassVar[bool] = True
    """Whether the mode needs a graph. If not, a trajectory is enough."""

    def __init__(self, context: ModeContext) -> None:
        self.context = context

    def enter(self) -> None:
        """Called when the mode becomes current."""

    def leave(self) -> None:
        """Called when another mode becomes current. Drops unfinished actions."""

    def cancel(self) -> bool:
        """Cancels the current action. Returns False if there is none."""
        return False

    def click(self, pointer: Pointer) -> bool:
        """Handles a left click. Returns False to leave it to the view."""
        return False

    def takes_drag(self, start: Pointer) -> bool:
        """Whether the mode handles a drag from there. If not, the drag moves the camera."""
        return False

    def drag(self, start: Pointer, now: Pointer) -> None:
        """Handles a move during an accepted drag."""

    def drop(self, start: Pointer, now: Pointer) -> None:
        """Handles the end of an accepted drag."""

    def hover(self, pointer: Pointer) -> bool:
        """Handles a move without a button. Returns True to turn off the view's own hover effect."""
        return False

    def away(self) -> None:
        """Called when the pointer leaves the view. Removes the hints at the pointer."""

    def takes_key(self, event: QKeyEvent) -> bool:
        """Whether the mode handles a key that is also the shortcut of a command."""
        return False

    def key(self, event: QKeyEvent) -> bool:
        """Handles a key press in a view. Returns whether the key was used."""
        return False

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        """Draws the current action, in the pixels of `surface`."""
