"""The page of an open frame: title, comparison modes and tools above, the canvas, and the layers beside it."""

from __future__ import annotations

from collections.abc import Iterable

from PySide6.QtCore import QEvent, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QAction, QKeyEvent
from PySide6.QtWidgets import QSizePolicy, QSlider, QToolBar, QToolButton, QWidget

from nvsim_app.frames.canvas import Canvas
from nvsim_app.frames.layers import FrameLayer, LayerList
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.icons import icon
from nvsim_app.look.labels import Label, MarkedLabel
from nvsim_app.look.widgets import Scrolling, named

_BRUSH = 100  # steps of the size slider
_CONTROL = Qt.KeyboardModifier.ControlModifier
_SHIFT = Qt.KeyboardModifier.ShiftModifier


class FramePage(QWidget):
    """The widgets of the frame page.

    gainChanged(float)   the gain of the difference
    sizeChanged(float)   the size of the brush, 0 to 1
    keyed(str)           a key of the page was pressed; one of the names in `_key`
    """

    gainChanged = Signal(float)
    sizeChanged = Signal(float)
    keyed = Signal(str)

    def __init__(self, layers: tuple[FrameLayer, ...]) -> None:
        super().__init__()
        self.brushing = False  # whether [ and ] change the size of the brush
        self.canvas = named(Canvas(layers, self), "Frame beside its render")
        self.layers = LayerList(layers, self)
        self.layers.changed.connect(lambda _: self.canvas.update())
        self.title = MarkedLabel(self)
        self.title.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.hint = Label(self, wordWrap=True, quiet=True)
        self.hint.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.gain = _slider(self, 10, 200, 30, "Gain of the difference")
        self.gain.valueChanged.connect(lambda value: self.gainChanged.emit(value / 10))
        self.brush_size = _slider(self, 0, _BRUSH, 40, "Size of the brush ([ and ], or the wheel)")
        self.brush_size.valueChanged.connect(lambda value: self.sizeChanged.emit(value / _BRUSH))
        self._gain_words, self._size_words = Label("Gain", self), Label("Size", self)
        # Tool bars move buttons without enough space into a menu, so that the page does not make the window wider.
        self._back, self._modes, self._tools = (_bar(self, name) for name in ("back", "modes", "tools"))
        self.title.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        sliders: tuple[QWidget | int, ...] = 8, self._gain_words, self.gain, 8, self._size_words, self.brush_size
        first = hbox(self._back, 10, (self.title, 1), *sliders, margins=(8, 4, 8, 0), spacing=4)
        second = hbox((self._modes, 10), (self._tools, 9), margins=(8, 4, 8, 0), spacing=4)
        side = vbox(MarkedLabel("<b>Layers</b>", self), (Scrolling(self.layers, self), 1), margins=8, spacing=8)
        middle = hbox((self.canvas, 1), side, spacing=0)
        low = hbox(self.hint, margins=(8, 4, 8, 4))
        vbox(first, second, (middle, 1), low, on=self, margins=0, spacing=4)
        self.show_mode("wipe")
        self.show_brush(None)
        self._apply_palette()

    def fill(self, back: Iterable[QAction], modes: Iterable[QAction], tools: Iterable[QAction | None]) -> None:
        """Adds buttons for the window's commands; None adds a separator."""
        for group, actions in ((self._back, back), (self._modes, modes), (self._tools, tools)):
            for action in actions:
                if action is None:
                    group.addSeparator()
                else:
                    group.addAction(action)

    def show_mode(self, mode: str) -> None:
        """Selects the comparison: one of canvas.MODES."""
        self.canvas.set_mode(mode)
        for widget in (self._gain_words, self.gain):
            widget.setVisible(mode == "difference")

    def show_brush(self, share: float | None) -> None:
        """Shows the size slider at `share` (0 to 1); None hides it, because no brush is selected."""
        self.brushing = share is not None
        for widget in (self._size_words, self.brush_size):
            widget.setVisible(share is not None)
        if share is not None:
            with QSignalBlocker(self.brush_size):
                self.brush_size.setValue(round(share * _BRUSH))

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._apply_palette()
        super().changeEvent(event)

    def _apply_palette(self) -> None:
        """Sets the icon of the overflow buttons, which the style draws in black and which is invisible in the dark
        theme."""
        for bar in self.findChildren(QToolBar):
            more = bar.findChild(QToolButton, "qt_toolbar_ext_button")
            if more is not None:
                more.setIcon(icon("next", self.palette()))
                more.setToolTip("More")

    # Keys of the page take precedence over the window's shortcuts, which are for the 3D view ----------------------

    def _key(self, event: QKeyEvent) -> str:
        key, modifiers = event.key(), event.modifiers()
        plain = not modifiers & (_CONTROL | Qt.KeyboardModifier.AltModifier)
        if modifiers & _CONTROL and key == Qt.Key.Key_Z:
            return "redo" if modifiers & _SHIFT else "undo"
        if modifiers & _CONTROL and key == Qt.Key.Key_Y:
            return "redo"
        if not plain:
            return ""
        names = {
            Qt.Key.Key_Escape: "leave",
            Qt.Key.Key_PageUp: "previous",
            Qt.Key.Key_PageDown: "next",
            Qt.Key.Key_Home: "fit",
        }
        if self.brushing:
            names |= {Qt.Key.Key_BracketLeft: "smaller", Qt.Key.Key_BracketRight: "larger"}
        return names.get(Qt.Key(key), "")

    def event(self, event: QEvent) -> bool:
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent) and self._key(event):
            event.accept()
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        name = self._key(event)
        if name:
            self.keyed.emit(name)
        else:
            super().keyPressEvent(event)


def _bar(parent: QWidget, name: str) -> QToolBar:
    bar = QToolBar(parent, toolButtonStyle=Qt.ToolButtonStyle.ToolButtonTextOnly)
    bar.setObjectName(f"frame_{name}")
    bar.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    layout = bar.layout()
    assert layout is not None, "a tool bar has one"
    layout.setSpacing(0)
    layout.setContentsMargins(0, 0, 0, 0)
    bar.setContextMenuPolicy(Qt.ContextMenuPolicy.PreventContextMenu)
    return bar


def _slider(parent: QWidget, low: int, high: int, value: int, words: str) -> QSlider:
    slider = named(QSlider(Qt.Orientation.Horizontal, parent), words, words)
    slider.setRange(low, high)
    slider.setValue(value)
    slider.setFixedWidth(110)
    slider.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click leaves the keyboard focus with the page
    return slider
