"""The current mode, and how it hears the mouse and draws in every view that shows the graph.

A press is held back until it is known whether it becomes a click or a drag: a mode may take clicks and leave drags to
the view, whose camera they move.
"""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, QPointF, Qt, QTimer, Signal
from PySide6.QtGui import QKeyEvent, QMouseEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import QApplication, QWidget

from app.layers.labels import short_ids
from app.look import colors
from app.modes import MODES
from app.modes.ink import label
from app.modes.mode import Mode, ModeContext, Pointer
from app.modes.review_marks import ReviewMarks
from app.modes.selection_marks import SelectionMarks
from app.state.document import Document
from app.views.graph_surface import GraphSurface
from app.views.navigation import CLICK_TOLERANCE

REFUSAL = 4000  # milliseconds a refusal stands at the cursor
Layer = Callable[[QPainter, GraphSurface], None]


class ModeController(QObject):
    """changed(str): another mode is current; said(str): what the mouse does now, for the status bar;
    menuWanted(Pointer): a click with the right button."""

    changed = Signal(str)
    said = Signal(str)
    menuWanted = Signal(object)

    def __init__(self, document: Document, parent: QObject) -> None:
        super().__init__(parent)
        self._document = document
        self.canvases: list[ModeOverlay] = []
        self.beneath: list[Layer] = []
        """What parts draw over the graph, under the marks of what is selected."""
        self.layers: list[Layer] = []
        """What parts draw over every view, in the pixels of its surface."""
        self.context = ModeContext(document, document.editing, self.said.emit, self.refresh)
        self.modes: dict[str, Mode] = {name: kind(self.context) for name, kind in MODES.items()}
        """Name -> mode; a part may add one of its own."""
        self.current: Mode = self.modes["select"]
        self._inputs: list[_Input] = []
        self._marks = SelectionMarks(document)
        self._reviewed = ReviewMarks(document)
        self._refusal = ""
        self._fade = QTimer(self, singleShot=True, interval=REFUSAL)
        self._fade.timeout.connect(self._forget)
        document.editing.refused.connect(self._refuse)
        document.graphChanged.connect(self._on_edit)
        document.selectionChanged.connect(self.refresh)

    def attach(self, surface: GraphSurface) -> None:
        """From now on the current mode works in this view too."""
        self.canvases.append(ModeOverlay(surface, self))
        self._inputs.append(_Input(surface, self))
        self.listen(surface.widget)

    def listen(self, widget: QWidget) -> None:
        """From now on the current mode hears the keys that are pressed in this widget."""
        _Keys(widget, self)

    def choose(self, name: str) -> None:
        """Makes another mode current."""
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
        """Gives up what was begun. Returns False when nothing was."""
        for hand in self._inputs:
            hand.give_up()
        return self.current.cancel()

    def cancel(self) -> None:
        """Gives up what was begun; if nothing was, goes back to Select; if it is there, selects nothing."""
        if self.give_up():
            return
        if self.current.name != "select":
            self.choose("select")
        else:
            self._document.select()

    @property
    def ready(self) -> bool:
        """Whether there is what the mode works on, so that the mouse means a mode rather than the view alone."""
        return self._document.graph is not None or (not self.current.needs_graph and len(self._document.extent) > 0)

    @property
    def refusal(self) -> str:
        """Why the last edit did not happen, while it is shown."""
        return self._refusal

    def refresh(self, _: object = None) -> None:
        """Draws the hints over the views again."""
        for canvas in self.canvases:
            # The view and with it the sheet: were both to ask, Qt would paint an opaque view twice.
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
        """What was refused is no matter any more."""
        if self._refusal:
            self._fade.stop()
            self._forget()
        self.refresh()

    def _refuse(self, sentence: str) -> None:
        self._refusal = short_ids(self._document.graph, sentence)
        self._fade.start()
        self.said.emit(self._refusal)
        self.refresh()

    def _forget(self) -> None:
        self._refusal = ""
        self.said.emit(self.current.hint)
        self.refresh()


class ModeOverlay(QWidget):
    """A clear sheet over a view, on which the modes draw."""

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
            self._stage.current.away()
            self.surface.widget.update()
        return False

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = painter.font()
        font.setPointSizeF(9)
        painter.setFont(font)
        self._stage.paint(painter, self.surface, self.cursor_at)
        painter.end()


class _Keys(QObject):
    """Hears a widget's keys before the widget does, and before the shortcuts of commands."""

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
    """Hears a view's mouse before the view does."""

    def __init__(self, surface: GraphSurface, stage: ModeController) -> None:
        super().__init__(surface.widget)
        self._surface, self._stage = surface, stage
        self._press: QMouseEvent | None = None  # held back
        self._start: Pointer | None = None
        self._dragging = False
        self._passing = False  # what we send ourselves is for the view
        self._given_up = False  # the button is still down, but the drag is over
        self._right: QPointF | None = None  # where the right button went down, while it may still be a click
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
            return False  # the view turns its camera by it
        if event.type() == QEvent.Type.MouseMove:
            return self._on_move(event)
        if event.type() == QEvent.Type.MouseButtonRelease and event.button() == Qt.MouseButton.LeftButton:
            return self._on_release(event)
        return False

    def _pointer(self, event: QMouseEvent) -> Pointer:
        return Pointer(self._surface, event.position(), event.modifiers())

    def give_up(self) -> None:
        """Nothing follows from a drag that is under way."""
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
        self._hand_over()
        return False

    def _on_release(self, event: QMouseEvent) -> bool:
        start, self._start = self._start, None
        if start is None:
            over, self._given_up = self._given_up, False
            return over
        if self._dragging:
            self._dragging = False
            self._stage.current.drop(start, self._pointer(event))
            return True
        if self._stage.current.click(start):
            return True
        self._hand_over()
        return False

    def _hand_over(self) -> None:
        """The press was the view's: it hears of it now."""
        press, self._press, self._start = self._press, None, None
        if press is not None:
            self._passing = True
            try:
                QApplication.sendEvent(self._surface.widget, press)
            finally:
                self._passing = False


def _copy(event: QMouseEvent) -> QMouseEvent:
    return QMouseEvent(
        event.type(),
        event.position(),
        event.globalPosition(),
        event.button(),
        event.buttons(),
        event.modifiers(),
        event.pointingDevice(),
    )
