"""The style of the window: the type scale, the grid of margins and spacing, the dark and the light palette, and the
style of plots. All colors come from the palette; there are no style sheets."""

from __future__ import annotations

from typing import Any, Literal

import pyqtgraph as pg
from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QColor, QFont, QFontInfo, QPalette
from PySide6.QtWidgets import QApplication, QWidget

from nvsim_app.look import colors
from nvsim_app.look.plain_text import escape_html

GRID = 8
"""Margins and spacing in pixels are multiples of this, or half of it inside a group of controls."""
HALF = GRID // 2

Size = Literal["small", "text", "large"]
_SCALE: dict[Size, float] = {"small": 0.88, "text": 1.0, "large": 1.35}


def type_font(size: Size = "text", bold: bool = False) -> QFont:
    """The font of the application in one of three sizes and two weights."""
    font = QApplication.font()
    font.setPointSizeF(points(size))
    font.setBold(bold)
    return font


def points(size: Size) -> float:
    """The points of a size, rounded to halves."""
    return round(2 * QFontInfo(QApplication.font()).pointSizeF() * _SCALE[size]) / 2


_R = QPalette.ColorRole
_DARK = {
    _R.Window: "#23272e",
    _R.WindowText: "#d7dde4",
    _R.Base: "#1b1f25",
    _R.AlternateBase: "#20252c",
    _R.Text: "#d7dde4",
    _R.Button: "#2c323b",
    _R.ButtonText: "#d7dde4",
    _R.BrightText: "#ffffff",
    _R.ToolTipBase: "#343b45",
    _R.ToolTipText: "#e6ebf0",
    _R.Highlight: "#2a7f78",
    _R.HighlightedText: "#ffffff",
    _R.Link: "#4fd1c5",
    _R.LinkVisited: "#8fb8de",
    _R.PlaceholderText: "#97a3b0",
    _R.Light: "#3a424d",
    _R.Midlight: "#323943",
    _R.Mid: "#191d22",
    _R.Dark: "#14171b",
    _R.Shadow: "#0c0e11",
    _R.Accent: "#2ec4b6",
}
_LIGHT = {
    _R.Window: "#f2f4f7",
    _R.WindowText: "#1f2730",
    _R.Base: "#ffffff",
    _R.AlternateBase: "#f6f8fa",
    _R.Text: "#1f2730",
    _R.Button: "#e9edf1",
    _R.ButtonText: "#1f2730",
    _R.BrightText: "#ffffff",
    _R.ToolTipBase: "#ffffff",
    _R.ToolTipText: "#1f2730",
    _R.Highlight: "#0f7d73",
    _R.HighlightedText: "#ffffff",
    _R.Link: "#0f766e",
    _R.LinkVisited: "#3b6ea5",
    _R.PlaceholderText: "#5c6773",
    _R.Light: "#ffffff",
    _R.Midlight: "#f7f9fb",
    _R.Mid: "#c9d1d9",
    _R.Dark: "#a9b4bf",
    _R.Shadow: "#7d8894",
    _R.Accent: "#178f84",
}
_FADED = {"dark": "#6b7682", "light": "#9aa5b1"}
THEMES = ("dark", "light")
SYSTEM = "system"
"""The theme of the desktop."""


def palette(theme: str) -> QPalette:
    """The palette of "dark" or "light"."""
    result = QPalette()
    for role, color in (_DARK if theme == "dark" else _LIGHT).items():
        result.setColor(role, QColor(color))
    for role in (_R.WindowText, _R.Text, _R.ButtonText, _R.HighlightedText):
        result.setColor(QPalette.ColorGroup.Disabled, role, QColor(_FADED[theme]))
    result.setColor(QPalette.ColorGroup.Disabled, _R.Highlight, result.color(_R.Button))
    return result


def apply(app: QApplication, theme: str) -> None:
    """Applies one of THEMES, or SYSTEM, to the application. Widgets receive a PaletteChange event."""
    app.setStyle("Fusion")
    hints = app.styleHints()
    if theme == SYSTEM:
        hints.unsetColorScheme()
        theme = "light" if hints.colorScheme() == Qt.ColorScheme.Light else "dark"
    else:
        # This has no effect on desktops without color schemes, so the palette is set too.
        hints.setColorScheme(Qt.ColorScheme.Dark if theme == "dark" else Qt.ColorScheme.Light)
    colors.set_text_theme(theme)
    app.setPalette(palette(theme))
    # For widgets that read the settings of pyqtgraph when they are created later.
    pg.setConfigOptions(antialias=True, background=None, foreground=app.palette().text().color())


def is_dark(source: QPalette) -> bool:
    return source.window().color().lightness() < 128


def title_size() -> str:
    """The size of the title of a plot, for pyqtgraph."""
    return f"{points('text'):g}pt"


class Plot(pg.PlotWidget):
    """A plot in the colors of the theme, without a menu. The mouse does not move it."""

    _ready = False  # Qt sends events while the base class is created
    _words = ""

    def __init__(self, name: str, parent: QWidget, **options: Any) -> None:
        """`name` is for screen readers; `options` are those of pyqtgraph.PlotWidget."""
        super().__init__(parent, enableMenu=False, **options)
        self.setAccessibleName(name)
        self.hideButtons()
        self.setMouseEnabled(x=False, y=False)
        self._ready = True
        self.apply_palette()

    def show_title(self, words: str) -> None:
        """Shows a title above the plot."""
        self._words = words
        self.apply_palette()

    def label_axes(self, bottom: str, left: str) -> None:
        """Sets the labels of the axes, including the unit."""
        self.setLabel("bottom", escape_html(bottom))
        self.setLabel("left", escape_html(left))

    def apply_palette(self) -> None:
        """Applies the colors of the palette."""
        palette = self.palette()
        self.setBackground(palette.base().color())
        for side in ("left", "bottom"):
            self.getAxis(side).setPen(palette.placeholderText().color())
            self.getAxis(side).setTextPen(palette.text().color())
        if self._words:
            self.setTitle(escape_html(self._words), size=title_size(), color=palette.text().color())

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and self._ready:
            self.apply_palette()
