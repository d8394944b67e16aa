"""What a mode of editing is: how clicks and drags in a view that shows the graph are taken.

A mode works through a GraphSurface alone, so it is the same in the map and in the 3D view.
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
    """The cursor at one moment: in which view, where in its pixels, and which keys are held."""

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
        """Whether nothing is to be snapped to."""
        return bool(self.modifiers & _M.AltModifier)

    @property
    def viewpoint(self) -> str | None:
        return self.surface.pick_viewpoint(self.point)

    @property
    def edge(self) -> tuple[str, str] | None:
        return self.surface.pick_edge(self.point)


@dataclass(frozen=True)
class ModeContext:
    """What every mode may use. `say` shows what a click would do; `refresh` draws the views' hints again."""

    document: Document
    editing: Editing
    say: Callable[[str], None]
    refresh: Callable[[], None]


class Mode:
    """The base: takes nothing, so that the view's own mouse works."""

    name: ClassVar[str] = ""
    hint: ClassVar[str] = ""
    """What the mouse does, for the status bar."""
    cursor: ClassVar[Qt.CursorShape] = Qt.CursorShape.ArrowCursor
    needs_graph: ClassVar[bool] = True
    """Whether it works on a graph; else a trajectory is enough."""

    def __init__(self, context: ModeContext) -> None:
        self.context = context

    def enter(self) -> None:
        """It became the current mode."""

    def leave(self) -> None:
        """Another mode follows; what was begun is forgotten."""

    def cancel(self) -> bool:
        """Gives up what was begun. Returns False when nothing was."""
        return False

    def click(self, pointer: Pointer) -> bool:
        """A click with the left button. Returns False to leave it to the view."""
        return False

    def takes_drag(self, start: Pointer) -> bool:
        """Whether a drag from there is this mode's; else it moves the camera."""
        return False

    def drag(self, start: Pointer, now: Pointer) -> None:
        """A drag that it takes went on."""

    def drop(self, start: Pointer, now: Pointer) -> None:
        """A drag that it takes ended."""

    def hover(self, pointer: Pointer) -> bool:
        """The cursor moved without a button. Returns True when the view's own hovering would be wrong."""
        return False

    def away(self) -> None:
        """The cursor left the view; what is said at it is over."""

    def takes_key(self, event: QKeyEvent) -> bool:
        """Whether a key is this mode's although it is the shortcut of a command."""
        return False

    def key(self, event: QKeyEvent) -> bool:
        """A key was pressed in a view. Returns whether it was used."""
        return False

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        """Draws what is being done, in the pixels of `surface`."""
