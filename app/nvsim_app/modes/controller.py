"""The controller of the editing modes: it passes mouse and key events to the current mode, and draws its marks in every
view of the graph.

A press is held back until it is a click or a drag. A mode may handle clicks and leave drags to the camera of the view.
"""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, QPointF, Qt, QTimer, Signal
from PySide6.QtGui import QKeyEvent, QMouseEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import QApplication, QWidget

from nvsim_app.layers.labels import short_ids
from nvsim_app.look import colors
from nvsim_app.modes import MODES
from nvsim_app.modes.marks import ReviewMarks, SelectionMarks
from nvsim_app.modes.mode import Mode, ModeContext, Pointer, label
from nvsim_app.state.document import Document
from nvsim_app.views.graph_surface import GraphSurface
from nvsim_app.views.navigation import CLICK_TOLERANCE

REFUSAL = 4000  # milliseconds that the reason of a refused edit is shown at the mouse pointer
Layer = Callable[[QPainter, GraphSurface], None]


class ModeController(QObject):
    """Selects the current mode and connects it to the views.

    changed(str): another mode is current. said(str): the effect of the mouse, for the status bar. menuWanted(Pointer):
    a right click.
    """

    changed = Signal(str)
    said = Signal(str)
    menuWanted = Signal(object)

    def __init__(self, document: Document, parent: QObject) -> None:
        super().__init__(parent)
        self._document = document
        self.canvases: list[ModeOverlay] = []
        self.beneath: list[Layer] = []
        """Painters of other parts, drawn over the graph and under the selection marks."""
        self.layers: list[Layer] = []
        """Painters of other parts, drawn on top, in the pixels of the surface."""
        self.context = ModeContext(document, document.editing, self.said.emit, self.refresh)
        self.modes: dict[str, Mode] = {name: kind(self.context) for name, kind in MODES.items()}
        """Name -> mode. A part of the window may add its own mode."""
        self.current: Mode = self.modes["select"]
        self._inputs: list[_Input] = []
        self._marks = SelectionMarks(document)
        self._reviewed = ReviewMarks(document)
        self._refusal = ""
        self._fade = QTimer(self, singleShot=True, interval=REFUSAL)
        self._fade.timeout.connect(self._clear_refusal)
        document.editing.refused.connect(self._refuse)
        document.graphChanged.connect(self._on_edit)
        document.selectionChanged.connect(self.refresh)
        document.projectChanged.connect(self._on_project)

    def attach(self, surface: GraphSurface) -> None:
        """Makes the modes work in this view."""
        self.canvases.append(ModeOverlay(surface, self))
        self._inputs.append(_Input(surface, self))
        self.listen(surface.widget)

    def listen(self, widget: QWidget) -> None:
        """Sends the key events of this widget to the current mode."""
        _Keys(widget, self)

    def choose(self, name: str) -> None:
        """Selects the current mode by name."""
        mode = self.modes[name]
        if mode is not self.current:
            self.current.leave()
            self.current = mode
            self._fade.stop()
            self._refusal = ""
            mode.enter()
            for canvas in self.canvases:
                canvas.surface.widget.setCursor(mode.cursor)
            self.changed.emit(name)
        self.said.emit(mode.hint)
        self.refresh()

    def give_up(self) -> bool:
        """Cancels the current action. Returns False if there is none."""
        for hand in self._inputs:
            hand.give_up()
        return self.current.cancel()

    def cancel(self) -> None:
        """Cancels the current action. Without one, returns to Select; in Select, clears the selection."""
        if self.give_up():
            return
        if self.current.name != "select":
            self.choose("select")
        else:
            self._document.select()

    @property
    def ready(self) -> bool:
        """Whether the document has content for the current mode. If not, the view handles the mouse alone."""
        return self._document.graph is not None or (not self.current.needs_graph and len(self._document.extent) > 0)

    @property
    def refusal(self) -> str:
        """The reason why the last edit was refused, while it is shown."""
        return self._refusal

    def refresh(self, _: object = None) -> None:
        """Repaints the marks in all views."""
        for canvas in self.canvases:
            # Update the view, which also updates the overlay. Updating both would paint an opaque view twice.
            canvas.surface.widget.update()

    def paint(self, painter: QPainter, surface: GraphSurface, cursor: QPointF | None) -> None:
        for layer in self.beneath:
            layer(painter, surface)
        self._marks.paint(painter, surface)
        self._reviewed.paint(painter, surface)
        for layer in self.layers:
            layer(painter, surface)
        self.current.paint(painter, surface)
        if self._refusal and cursor is not None:
            label(painter, cursor + QPointF(0, 26), self._refusal, colors.SELECTED)

    def _on_edit(self, _: object) -> None:
        """Clears the refusal, because the graph changed."""
        if self._refusal:
            self._fade.stop()
            self._clear_refusal()
        self.refresh()

    def _on_project(self) -> None:
        """Clears all labels at the mouse pointer, because they are about the previous project."""
        self.give_up()
        self.current.on_pointer_left()
        for canvas in self.canvases:
            canvas.cursor_at = None
        if self._refusal:
            self._fade.stop()
            self._clear_refusal()
        self.refresh()

    def _refuse(self, sentence: str) -> None:
        self._refusal = short_ids(self._document.graph, sentence)
        self._fade.start()
        self.said.emit(self._refusal)
        self.refresh()

    def _clear_refusal(self) -> None:
        self._refusal = ""
        self.said.emit(self.current.hint)
        self.refresh()


class ModeOverlay(QWidget):
    """A transparent widget over a view, on which the modes draw."""

    def __init__(self, surface: GraphSurface, stage: ModeController) -> None:
        super().__init__(surface.widget)
        self.surface, self._stage = surface, stage
        self.cursor_at: QPointF | None = None
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.setAttribute(Qt.WidgetAttribute.WA_NoSystemBackground)
        self.resize(surface.widget.size())
        surface.widget.installEventFilter(self)
        self.show()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize:
            self.resize(self.surface.widget.size())
        elif event.type() == QEvent.Type.Leave:
            self.cursor_at = None
            self._stage.current.on_pointer_left()
            self.surface.widget.update()
        return False

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._stage.paint(painter, self.surface, self.cursor_at)
        painter.end()


class _Keys(QObject):
    """Handles key events before the widget and before the shortcuts of commands."""

    def __init__(self, widget: QWidget, stage: ModeController) -> None:
        super().__init__(widget)
        self._stage = stage
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if not isinstance(event, QKeyEvent):
            return False
        if event.type() == QEvent.Type.ShortcutOverride and self._stage.current.takes_key(event):
            event.accept()
            return True
        return event.type() == QEvent.Type.KeyPress and self._stage.current.key(event)


class _Input(QObject):
    """Handles the mouse events of a view before the view does."""

    def __init__(self, surface: GraphSurface, stage: ModeController) -> None:
        super().__init__(surface.widget)
        self._surface, self._stage = surface, stage
        self._press: QMouseEvent | None = None  # the press that is held back
        self._start: Pointer | None = None
        self._dragging = False
        self._passing = False  # true while this object sends an event to the view
        self._given_up = False  # the drag was canceled while the button is still down
        self._right: QPointF | None = None  # position of a right press that may still become a click
        surface.widget.setMouseTracking(True)
        surface.widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if self._passing:
            return False
        if not isinstance(event, QMouseEvent):
            return False
        if event.type() == QEvent.Type.MouseButtonPress and event.button() == Qt.MouseButton.LeftButton:
            return self._on_press(event)
        if event.button() == Qt.MouseButton.RightButton:
            self._on_right(event)
            return False  # the view turns its camera with the right button
        if event.type() == QEvent.Type.MouseButtonDblClick and self._stage.current.name != "select":
            return self._on_press(event)  # two quick clicks of an editing mode
        if event.type() == QEvent.Type.MouseMove:
            return self._on_move(event)
        if event.type() == QEvent.Type.MouseButtonRelease and event.button() == Qt.MouseButton.LeftButton:
            return self._on_release(event)
        return False

    def _pointer(self, event: QMouseEvent) -> Pointer:
        return Pointer(self._surface, event.position(), event.modifiers())

    def give_up(self) -> None:
        """Cancels the current drag."""
        self._given_up, self._dragging, self._start = self._dragging, False, None

    def _on_right(self, event: QMouseEvent) -> None:
        start, self._right = self._right, None
        if event.type() == QEvent.Type.MouseButtonPress:
            self._right = event.position()
        elif (
            start is not None
            and (event.position() - start).manhattanLength() <= CLICK_TOLERANCE
            and self._stage.context.document.graph is not None
        ):
            self._stage.menuWanted.emit(self._pointer(event))

    def _on_press(self, event: QMouseEvent) -> bool:
        if not self._stage.ready:
            return False
        self._start, self._press, self._dragging = self._pointer(event), _copy(event), False
        self._given_up = False
        self._surface.widget.setFocus()
        return True

    def _on_move(self, event: QMouseEvent) -> bool:
        now = self._pointer(event)
        for canvas in self._stage.canvases:
            canvas.cursor_at = now.point if canvas.surface is self._surface else None
        if self._given_up:
            return True
        if self._start is None:
            return self._stage.ready and not event.buttons() and self._stage.current.hover(now)
        if self._dragging:
            self._stage.current.drag(self._start, now)
            return True
        if (now.point - self._start.point).manhattanLength() <= CLICK_TOLERANCE:
            return True
        if self._stage.current.takes_drag(self._start):
            self._dragging = True
            self._stage.current.drag(self._start, now)
            return True
        self._send_held_press()
        return False

    def _on_release(self, event: QMouseEvent) -> bool:
        start, self._start = self._start, None
        if start is None:
            over, self._given_up = self._given_up, False
            return over
        if self._dragging:
            self._dragging = False
            self._stage.current.end_drag(start, self._pointer(event))
            return True
        if self._stage.current.click(start):
            return True
        self._send_held_press()
        return False

    def _send_held_press(self) -> None:
        """Sends the press that was held back to the view."""
        press, self._press, self._start = self._press, None, None
        if press is not None:
            self._passing = True
            try:
                QApplication.sendEvent(self._surface.widget, press)
            finally:
                self._passing = False


def _copy(event: QMouseEvent) -> QMouseEvent:
    return QMouseEvent(
        QEvent.Type.MouseButtonPress,
        event.position(),
        event.globalPosition(),
        event.button(),
        event.buttons(),
        event.modifiers(),
        event.pointingDevice(),
    )
