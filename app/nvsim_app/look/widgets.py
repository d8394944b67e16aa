"""Small widgets that all parts of the window share: buttons of dialogs, fields of numbers, panels that scroll, the
status bar, and frames around widgets."""

from __future__ import annotations

from typing import Any, TypeVar

from PySide6.QtCore import QEvent, QObject, QRect, QRectF, QSize, Qt
from PySide6.QtGui import QIcon, QPainter, QPaintEvent, QPen, QRegion, QShowEvent, QValidator, QWheelEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QBoxLayout,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QDoubleSpinBox,
    QFormLayout,
    QFrame,
    QGridLayout,
    QLayout,
    QLineEdit,
    QMainWindow,
    QMenuBar,
    QPushButton,
    QScrollArea,
    QStatusBar,
    QTabBar,
    QToolButton,
    QWidget,
)
from shiboken6 import isValid

from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.theme import GRID, HALF, type_font

AnyWidget = TypeVar("AnyWidget", bound=QWidget)
_RIM = QSize(20, 50)  # pixels that the frame of a window manager may take


class Dialog(QDialog):
    """A dialog that fits the screen, and whose margins and spacing are on the grid when it is shown."""

    def showEvent(self, event: QShowEvent) -> None:
        if not event.spontaneous():
            align_to_grid(self)
            self.fit_screen()
        super().showEvent(event)

    def fit_screen(self) -> None:
        """Makes the dialog small enough for its screen, so that its buttons are visible."""
        self.resize(self.size().boundedTo(self.screen().availableSize() - _RIM))


class DialogButtons(QDialogButtonBox):
    """Buttons with text only. The style would add a red cross to Cancel alone."""

    def showEvent(self, event: QShowEvent) -> None:
        for button in self.buttons():
            button.setIcon(QIcon())
        super().showEvent(event)


def named(widget: AnyWidget, name: str = "", tip: str = "") -> AnyWidget:
    """The widget, after giving it a name for screen readers and a tooltip; "" keeps its own."""
    if name:
        widget.setAccessibleName(name)
    if tip:
        widget.setToolTip(tooltip_text(tip))
    return widget


def push_button(text: str, parent: QWidget | None, clicked: object, tip: str = "", **properties: Any) -> QPushButton:
    """A button. `clicked` is a function or a signal, and `properties` are Qt properties."""
    button = QPushButton(text, parent, **properties)
    button.setToolTip(tooltip_text(tip))
    button.clicked.connect(clicked)
    return button


def tool_button(
    text: str, parent: QWidget | None, clicked: object = None, tip: str = "", **properties: Any
) -> QToolButton:
    """A small button, without a function if it opens a menu. Otherwise like `push_button`."""
    button = QToolButton(parent, **properties)
    button.setText(text)
    button.setToolTip(tooltip_text(tip))
    if clicked is not None:
        button.clicked.connect(clicked)
    return button


def show_and_focus(window: QWidget) -> None:
    """Shows a non-modal window and gives it the keyboard focus, so that Esc closes it and Tab moves through it."""
    window.show()
    window.raise_()
    window.activateWindow()
    if window.focusWidget() is None:
        window.setFocus()
        window.focusNextPrevChild(True)


def align_to_grid(root: QWidget) -> None:
    """Rounds the margins and spacing of all layouts in `root` up to the grid. The style sets 6, 9, and 11 pixels where
    a layout sets none."""
    for layout in root.findChildren(QLayout):
        owner = layout.parentWidget()
        if owner is None or isinstance(owner, QStatusBar):  # which makes its layout again
            continue
        if layout is owner.layout():
            margins = layout.contentsMargins()
            sides = (margins.left(), margins.top(), margins.right(), margins.bottom())
            if any(side % HALF for side in sides):
                layout.setContentsMargins(*(_on_grid(side) for side in sides))
        if isinstance(layout, QGridLayout | QFormLayout):
            layout.setHorizontalSpacing(_on_grid(layout.horizontalSpacing()))
            layout.setVerticalSpacing(_on_grid(layout.verticalSpacing()))
        elif isinstance(layout, QBoxLayout):
            layout.setSpacing(_on_grid(layout.spacing()))


def _on_grid(pixels: int) -> int:
    return -(-pixels // HALF) * HALF


LEAST = 96  # maximum of the minimum height, pixels


class Scrolling(QScrollArea):
    """A scroll area around `inner`. Scroll bars appear if `inner` needs more space than available."""

    def __init__(self, inner: QWidget, parent: QWidget | None = None) -> None:
        super().__init__(parent, widgetResizable=True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # Tab moves to the widgets in it
        self._inner = inner
        self.setWidget(inner)
        inner.installEventFilter(self)

    def minimumSizeHint(self) -> QSize:
        least = self._inner.minimumSizeHint()
        width = least.width()
        if self.horizontalScrollBarPolicy() == Qt.ScrollBarPolicy.ScrollBarAlwaysOff:
            width += self.verticalScrollBar().sizeHint().width() + 2 * self.frameWidth()
        return QSize(width, min(LEAST, least.height()))

    def sizeHint(self) -> QSize:
        return self._inner.sizeHint()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.LayoutRequest:
            self.updateGeometry()
        return super().eventFilter(watched, event)


_DIRECT = Qt.FindChildOption.FindDirectChildrenOnly


class StatusLine(QStatusBar):
    """A status bar that shows as many clauses of a message, separated by " · ", as fit before the permanent widgets.
    The tooltip has all of them."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.messageChanged.connect(lambda words: self.setToolTip(tooltip_text(words)))

    def paintEvent(self, event: QPaintEvent) -> None:
        words = self.currentMessage()
        if not words:
            super().paintEvent(event)
            return
        shown = [w for w in self.findChildren(QWidget, options=_DIRECT) if w.isVisible()]
        right = min([w.x() for w in shown if w.x() > GRID], default=self.width())
        painter = QPainter(self)
        painter.setPen(self.palette().windowText().color())
        box = self.rect().adjusted(GRID, 0, right - GRID - self.width(), 0)
        metrics = painter.fontMetrics()
        while " · " in words and metrics.horizontalAdvance(words) > box.width():
            words = words.rpartition(" · ")[0]
        text = metrics.elidedText(words, Qt.TextElideMode.ElideRight, box.width())
        painter.drawText(box, Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft, text)


_FRAME = 4.0  # pixels


class DropTarget(QWidget):
    """Covers `window` with a colored frame and a sentence, and ignores the mouse."""

    def __init__(self, window: QWidget) -> None:
        super().__init__(window)
        self.words = ""
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        window.installEventFilter(self)
        self.hide()

    def show_words(self, words: str) -> None:
        """Shows the frame with a sentence; "" hides it."""
        self.words = words
        self.setGeometry(0, 0, self.window().width(), self.window().height())
        self.setVisible(bool(words))
        self.raise_()
        self.update()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize and self.isVisible():
            self.setGeometry(0, 0, self.window().width(), self.window().height())
        return False

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        accent = self.palette().accent().color()
        edge = _FRAME / 2
        painter.setPen(QPen(accent, _FRAME))
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(edge, edge, -edge, -edge), 6, 6)
        painter.setFont(type_font("large"))
        box = painter.fontMetrics().boundingRect(self.rect(), Qt.AlignmentFlag.AlignCenter, self.words)
        box.adjust(-20, -12, 20, 12)
        painter.setBrush(self.palette().toolTipBase())
        painter.drawRoundedRect(box, 6, 6)
        painter.setPen(self.palette().toolTipText().color())
        painter.drawText(box, Qt.AlignmentFlag.AlignCenter, self.words)


class NumberBox(QDoubleSpinBox):
    """A number with steps. `valueChanged` is emitted on Enter, when the focus leaves, and for steps, but not while the
    user types. The decimal sign is a point or a comma. The wheel scrolls the page, not the number.

    suffix  unit after the number
    """

    def __init__(
        self,
        name: str,
        low: float,
        high: float,
        value: float,
        decimals: int = 2,
        step: float = 1.0,
        suffix: str = "",
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent, decimals=decimals, singleStep=step, suffix=suffix)
        self.setAccessibleName(name)
        self.setKeyboardTracking(False)
        self.setRange(low, high)
        self.setValue(value)

    def validate(self, text: str, place: int) -> tuple[QValidator.State, str, int]:
        """Accepts a comma as the decimal sign."""
        return super().validate(self._with_own_sign(text), place)

    def valueFromText(self, text: str) -> float:
        return super().valueFromText(self._with_own_sign(text))

    def _with_own_sign(self, text: str) -> str:
        own = self.locale().decimalPoint()
        return text.replace("," if own == "." else ".", own)

    def wheelEvent(self, event: QWheelEvent) -> None:
        event.ignore()


_RING = 2  # pixels
_OWN = (
    QAbstractButton, QAbstractSlider, QAbstractSpinBox, QComboBox, Label, QLineEdit, QMenuBar, QTabBar
)  # fmt: skip
"""Widgets whose focus the style draws."""


class FocusRing(QWidget):
    """An overlay of `window` that ignores the mouse and covers only the border of the focused widget."""

    def __init__(self, window: QMainWindow) -> None:
        super().__init__(window)
        self.setObjectName("focusRing")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.around: QWidget | None = None
        self.hide()
        app = QApplication.instance()
        assert isinstance(app, QApplication)
        app.focusChanged.connect(self._on_focus)

    def _on_focus(self, _: QWidget | None, now: QWidget | None) -> None:
        if self.around is not None and isValid(self.around):
            self.around.removeEventFilter(self)
            self.around.destroyed.disconnect(self._hide_ring)
        self.around = now if now is not None and now.window() is self.window() and not isinstance(now, _OWN) else None
        if self.around is not None:
            self.around.installEventFilter(self)
            self.around.destroyed.connect(self._hide_ring)
        self._place()

    def _hide_ring(self) -> None:
        self.around = None
        self.hide()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() in (QEvent.Type.Resize, QEvent.Type.Move, QEvent.Type.Show, QEvent.Type.Hide):
            self._place()
        return False

    def _place(self) -> None:
        widget = self.around
        if widget is None or not widget.isVisible():
            self.hide()
            return
        seen, above = QRect(widget.mapTo(self.window(), widget.rect().topLeft()), widget.size()), widget.parentWidget()
        while above is not None and above is not self.window():  # a scroll area may show only a part
            seen &= QRect(above.mapTo(self.window(), above.rect().topLeft()), above.size())
            above = above.parentWidget()
        self.setGeometry(seen)
        inner = self.rect().adjusted(_RING, _RING, -_RING, -_RING)
        self.setMask(QRegion(self.rect()) - QRegion(inner))
        self.show()
        self.raise_()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), self.palette().link())
        painter.end()
