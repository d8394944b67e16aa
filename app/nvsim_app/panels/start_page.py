"""The start page, shown while nothing is open: buttons to open or create a project, a demo, and recent projects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from PySide6.QtCore import QEvent, QModelIndex, QPersistentModelIndex, QRect, QRectF, QSize, Qt, Signal
from PySide6.QtGui import (
    QColor,
    QIcon,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPainterPath,
    QPaintEvent,
    QPen,
    QPixmap,
    QShowEvent,
)
from PySide6.QtWidgets import (
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QStackedLayout,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from nvsim.capture import formats
from nvsim_app.look import colors
from nvsim_app.look.boxes import STRETCH, hbox, vbox
from nvsim_app.look.icons import icon
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import plain, tooltip_text
from nvsim_app.look.theme import GRID, type_font
from nvsim_app.look.widgets import Scrolling, push_button
from nvsim_app.state.side_work import ProjectPreview

_THUMBNAIL = QSize(96, 64)
_GAP = 8
_PATH, _GONE = Qt.ItemDataRole.UserRole, Qt.ItemDataRole.UserRole + 1


class _RecentItem(QStyledItemDelegate):
    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> QSize:
        return QSize(200, _THUMBNAIL.height() + 2 * _GAP)

    def paint(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        style, widget = option.widget.style(), option.widget
        style.drawPrimitive(QStyle.PrimitiveElement.PE_PanelItemViewItem, option, painter, widget)
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        gone, path = bool(index.data(_GONE)), Path(str(index.data(_PATH)))
        box = QRect(option.rect.topLeft(), _THUMBNAIL).translated(_GAP, _GAP)
        self._thumbnail(painter, box, index.data(Qt.ItemDataRole.DecorationRole), option, gone)
        words = option.rect.adjusted(_THUMBNAIL.width() + 2 * _GAP + 4, _GAP, -_GAP, -_GAP)
        palette = option.palette
        ink = palette.highlightedText().color() if chosen else palette.text().color()
        quiet = ink if chosen else palette.placeholderText().color()
        bold = type_font(bold=True)
        rows = [(plain(path.name), bold, quiet if gone else ink), (plain(path.parent, 1000), option.font, quiet)]
        if gone:
            warning = ink if chosen else QColor(colors.text("warning"))
            rows.append(("Folder not found. Press Del to remove it.", option.font, warning))
        height = option.fontMetrics.height() + 2
        top = words.top() + max(0, (words.height() - height * len(rows)) // 2)
        for text, font, color in rows:
            painter.setFont(font)
            painter.setPen(color)
            elided = painter.fontMetrics().elidedText(text, Qt.TextElideMode.ElideMiddle, words.width())
            painter.drawText(QRect(words.left(), top, words.width(), height), Qt.AlignmentFlag.AlignVCenter, elided)
            top += height
        painter.restore()

    def _thumbnail(
        self, painter: QPainter, box: QRect, image: object, option: QStyleOptionViewItem, gone: bool
    ) -> None:
        shape = QPainterPath()
        shape.addRoundedRect(QRectF(box), 4, 4)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.fillPath(shape, option.palette.midlight())
        pixmap = image.pixmap(image.availableSizes()[0]) if isinstance(image, QIcon) and not image.isNull() else None
        if pixmap is None:
            icon("nvsim", option.palette).paint(
                painter, box.adjusted(20, 16, -20, -16), mode=QIcon.Mode.Disabled if gone else QIcon.Mode.Normal
            )
            return
        painter.setClipPath(shape)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.setOpacity(0.4 if gone else 1.0)
        # The largest central part with the aspect ratio of the box.
        share = min(pixmap.width() / box.width(), pixmap.height() / box.height())
        part = QRectF(0, 0, box.width() * share, box.height() * share)
        part.moveCenter(QRectF(pixmap.rect()).center())
        painter.drawPixmap(QRectF(box), pixmap, part)
        painter.setOpacity(1.0)
        painter.setClipping(False)


class RecentList(QListWidget):
    """Recent projects. chosen(Path): Enter or a double-click. forgotten(Path): Del."""

    chosen = Signal(object)
    forgotten = Signal(object)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setItemDelegate(_RecentItem(self))
        self.setUniformItemSizes(True)
        self.setAccessibleName("Recent projects")
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.itemDoubleClicked.connect(self._choose)

    def show_projects(self, paths: Sequence[Path]) -> None:
        """Replaces the list. Keeps the thumbnails and states of projects that stay."""
        known = {self._path(item): item for item in self._items()}
        current = self.current
        kept = {path: (known[path].icon(), known[path].data(_GONE)) for path in paths if path in known}
        self.clear()
        for path in paths:
            item = QListWidgetItem(plain(path.name), self)
            item.setToolTip(tooltip_text(path))
            item.setData(_PATH, str(path))
            if path in kept:
                item.setIcon(kept[path][0])
                item.setData(_GONE, kept[path][1])
        if self.count():
            self.setCurrentRow(list(paths).index(current) if current is not None and current in paths else 0)

    def show_looks(self, looked: Mapping[Path, ProjectPreview]) -> None:
        """Shows the states and thumbnails of the projects."""
        for item in self._items():
            found = looked.get(self._path(item))
            if found is None:
                continue
            item.setData(_GONE, not found.there)
            pixmap = QPixmap()
            if found.picture and pixmap.loadFromData(found.picture):
                item.setIcon(QIcon(pixmap))

    @property
    def current(self) -> Path | None:
        item = self.currentItem()
        return None if item is None else self._path(item)

    @property
    def missing_projects(self) -> tuple[Path, ...]:
        """The projects whose folder is known to be missing."""
        return tuple(self._path(item) for item in self._items() if item.data(_GONE))

    def forget_current(self) -> None:
        if self.current is not None:
            self.forgotten.emit(self.current)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.currentItem() is not None:
            self._choose(self.currentItem())
        elif event.key() in (Qt.Key.Key_Delete, Qt.Key.Key_Backspace):
            self.forget_current()
        else:
            super().keyPressEvent(event)

    def _choose(self, item: QListWidgetItem) -> None:
        self.chosen.emit(self._path(item))

    def _path(self, item: QListWidgetItem) -> Path:
        return Path(str(item.data(_PATH)))

    def _items(self) -> list[QListWidgetItem]:
        return [self.item(row) for row in range(self.count())]


KINDS = (
    ("Project", "a folder NAME.nvsim"),
    ("Capture", f"images with camera poses: {formats.names()}"),
    ("Video or photographs", "of a building, from a phone, an action camera, or a 360 degree camera"),
    ("Graph", "R2R connectivity, one file or a folder of files"),
    ("Splats", "PLY, compressed PLY, SPZ, SOG, .splat, from any program"),
)
"""The kinds that can be opened, with a description of each."""


class DropZone(QWidget):
    """A visible drop target; the whole window accepts drops. clicked(): the user clicked it."""

    clicked = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._hot = False
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.setAccessibleName("Drop a project, a capture, a video, a graph or a splat file here")
        words = Label("Drop a file or folder here", self, font=type_font(bold=True))
        layout = vbox(words, on=self, margins=(2 * GRID, GRID, 2 * GRID, GRID), spacing=4)
        for kind, what in KINDS:
            row = Label(f"{kind} – {what}", self, wordWrap=True, quiet=True)
            layout.addWidget(row)

    def highlight(self, on: bool) -> None:
        """Highlights the zone while a file that can be dropped hovers over the window."""
        self._hot = on
        self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self.rect().contains(event.position().toPoint()):
            self.clicked.emit()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        palette = self.palette()
        color = palette.accent().color() if self._hot else palette.placeholderText().color()
        painter.setPen(QPen(color, 2.0 if self._hot else 1.2, Qt.PenStyle.DashLine))
        painter.setBrush(palette.base() if self._hot else Qt.BrushStyle.NoBrush)
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(1, 1, -1, -1), 8, 8)


class StartPage(QWidget):
    """Signals: openWanted(), newWanted(), demoWanted(), recentWanted(Path), forgetWanted(Path)."""

    openWanted = Signal()
    newWanted = Signal()
    demoWanted = Signal()
    recentWanted = Signal(object)
    forgetWanted = Signal(object)

    def __init__(self) -> None:
        super().__init__(autoFillBackground=True)
        self._mark = Label(self)
        self._mark.setFixedSize(44, 44)
        name = Label("NVSim", self, font=type_font("large", bold=True))
        words = Label(
            "Turn a capture of a building into a simulator for vision-and-language navigation.",
            self,
            wordWrap=True,
            quiet=True,
        )
        self.open = self._button(
            "Open…", "A project, a capture, a video, a graph or a splat file (Ctrl+O)", self.openWanted
        )
        self.new = self._button(
            "New project from a capture or video…",
            "Check a capture or a video and create a project from it (Ctrl+N)",
            self.newWanted,
        )
        self.demo = self._button(
            "Try the built-in building…", "Generate a building with ground truth and run all stages on it",
            self.demoWanted,
        )  # fmt: skip
        self.open.setDefault(True)
        self.drop = DropZone(self)
        self.drop.clicked.connect(self.openWanted)
        head = hbox(self._mark, (name, 1))
        left = vbox(head, words, GRID, self.open, self.new, self.demo, GRID, self.drop, STRETCH)
        holder = QWidget(self)
        holder.setLayout(left)
        column = Scrolling(holder, self)  # in a low window, so that no text is cut off
        column.setFixedWidth(360)
        recent = Label("Recent projects", self, font=type_font(bold=True))
        self.recent = RecentList(self)
        self.recent.setMinimumWidth(260)
        self.recent.chosen.connect(self.recentWanted)
        self.recent.forgotten.connect(self.forgetWanted)
        self.nothing = Label(
            "Recent projects appear here.", self, alignment=Qt.AlignmentFlag.AlignCenter, wordWrap=True, quiet=True
        )
        self._recents = QStackedLayout()
        self._recents.addWidget(self.recent)
        self._recents.addWidget(self.nothing)
        tip = "Remove the project from this list (Del); its files do not change"
        self.forget = push_button("Remove", self, self.recent.forget_current, tip)
        self.go = push_button("Open project", self, self._choose, "Open the selected project (Enter)")
        below = hbox(STRETCH, self.forget, self.go)
        right = vbox(recent, (self._recents, 1), below)
        right_holder = QWidget(self, maximumWidth=640)
        right_holder.setLayout(right)
        both = hbox(STRETCH, column, (right_holder, 8), STRETCH, spacing=24)
        vbox((both, 1), on=self, margins=2 * GRID)
        self.apply_palette()
        self.show_recent(())

    def minimumSizeHint(self) -> QSize:
        """A small size, so that the hidden page does not force a minimum width on the window."""
        return QSize(300, 200)

    def _button(self, text: str, what: str, wanted: object) -> QPushButton:
        return push_button(text, self, wanted, what, minimumHeight=30, autoDefault=True)

    def apply_palette(self) -> None:
        """Draws the logo in the colors of the palette."""
        self._mark.setPixmap(icon("nvsim", self.palette()).pixmap(40, 40))

    def show_recent(self, paths: Sequence[Path]) -> None:
        """Lists these projects."""
        self.recent.show_projects(paths)
        self._recents.setCurrentWidget(self.recent if paths else self.nothing)
        for button in (self.forget, self.go):
            button.setVisible(bool(paths))

    def _choose(self) -> None:
        if self.recent.current is not None:
            self.recentWanted.emit(self.recent.current)

    def take_keys(self) -> None:
        """Moves the keyboard focus to the list, or to Open if the list is empty."""
        (self.recent if self.recent.count() else self.open).setFocus()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange:
            self.apply_palette()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self.take_keys()
