"""The help window: a list of pages with a search on the left, the selected page on the right. The pages are in
nvsim_resources/help, and the page about the window of the documentation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from PySide6.QtCore import QByteArray, QSignalBlocker, Qt, QUrl
from PySide6.QtGui import QImage, QPalette, QTextCharFormat, QTextCursor, QTextDocument, QTextTable
from PySide6.QtWidgets import QLineEdit, QListWidget, QListWidgetItem, QTextBrowser, QTextEdit, QWidget

import nvsim_resources
from nvsim.capture import formats
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.widgets import Dialog, named, show_and_focus

FOLDER = Path(nvsim_resources.__file__).parent / "help"
DOCS = FOLDER.parent / "docs"  # contains images, too
_ORDER = ("start", "window", "keys", "view", "inspector", "thresholds", "frames")  # others follow by title


@dataclass(frozen=True)
class Section:
    """A heading of a page and the Markdown under it."""

    page: str
    title: str
    text: str


@dataclass(frozen=True)
class Page:
    """A help page. name: the file name without suffix. title: the first heading."""

    name: str
    title: str
    text: str
    sections: tuple[Section, ...]


@cache
def help_pages() -> tuple[Page, ...]:
    """All pages in reading order."""
    found = [_page(path) for path in (*FOLDER.glob("*.md"), DOCS / "window.md")]
    known = {name: i for i, name in enumerate(_ORDER)}
    return tuple(sorted(found, key=lambda p: (known.get(p.name, len(known)), p.title)))


def find(words: str) -> list[Section]:
    """Sections that contain all words. Those that contain them as one phrase are first, then those with one of them in
    the heading."""
    wanted = words.casefold().split()
    if not wanted:
        return []
    hits = []
    for page in help_pages():
        for section in page.sections:
            text = " ".join(f"{section.title} {section.text}".casefold().split())
            if all(word in text for word in wanted):
                in_title = any(word in section.title.casefold() for word in wanted)
                hits.append((" ".join(wanted) not in text, not in_title, section))
    return [section for *_, section in sorted(hits, key=lambda hit: hit[:2])]


def _page(path: Path) -> Page:
    text = path.read_text(encoding="utf-8").replace("{formats of captures}", formats.names())
    sections: list[Section] = []
    title, lines = "", list[str]()
    for line in [*text.splitlines(), "# "]:
        if line.startswith("#"):
            if title or any(part.strip() for part in lines):
                sections.append(Section(path.stem, title, "\n".join(lines)))
            title, lines = line.lstrip("# ").strip(), []
        else:
            lines.append(line)
    return Page(path.stem, sections[0].title if sections else path.stem, text, tuple(sections))


_SECTION = Qt.ItemDataRole.UserRole


class _Text(QTextBrowser):
    """A page of help. Scales images down to the available width, and reads no other files."""

    def loadResource(self, type: int, name: QUrl | str) -> object:
        if type == QTextDocument.ResourceType.ImageResource.value:
            image = QImage(str(DOCS / QUrl(name).fileName()))
            ratio = self.devicePixelRatioF()
            room = round(ratio * max(200, self.viewport().width() - 60))
            if image.width() > room:
                image = image.scaledToWidth(room, Qt.TransformationMode.SmoothTransformation)
            image.setDevicePixelRatio(ratio)
            return image
        return QByteArray()  # if it were None, Qt would read the file


class HelpWindow(Dialog):
    """A non-modal window, so that it can stay open beside the main window."""

    def __init__(self, page: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("NVSim help")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.resize(820, 640)
        self.page = ""
        self.search = QLineEdit(self, placeholderText="Find in the help", clearButtonEnabled=True)
        self.search.setAccessibleName("Search the help")
        self.search.textChanged.connect(self._fill)
        self.list = named(QListWidget(self), "Pages")
        self.list.setFrameShape(self.list.Shape.NoFrame)
        self.list.setFixedWidth(230)
        self.list.setWordWrap(True)
        self.list.currentItemChanged.connect(self._on_current)
        self.text = named(_Text(self), "Help page")
        self.text.setFrameShape(self.text.Shape.NoFrame)
        self.text.setOpenExternalLinks(False)
        self.text.document().setDocumentMargin(14)
        beside = vbox(self.search, (self.list, 1))
        hbox(beside, (self.text, 1), on=self)
        self._fill("")
        self.show_page(page)

    def show_page(self, name: str, heading: str = "") -> None:
        """Shows a page, scrolled to one of its headings. An unknown name shows the first page."""
        page = next((p for p in help_pages() if p.name == name), help_pages()[0])
        if page.name != self.page:
            self.page = page.name
            self.text.setMarkdown(page.text)
            self._space_tables()
            if not self.search.text():
                self._mark_current()
        self.text.moveCursor(QTextCursor.MoveOperation.Start)
        if heading and self.text.find(heading, QTextDocument.FindFlag.FindCaseSensitively):
            cursor = self.text.textCursor()
            cursor.clearSelection()
            self.text.setTextCursor(cursor)
            bar = self.text.verticalScrollBar()
            bar.setValue(bar.value() + self.text.cursorRect(cursor).top() - 20)
        self._highlight()

    def _space_tables(self) -> None:
        """Adds margins to tables and lightens their borders, because Markdown has no styles for tables."""
        for frame in self.text.document().rootFrame().childFrames():
            if isinstance(frame, QTextTable):
                style = frame.format()
                style.setTopMargin(4)
                style.setBottomMargin(12)
                style.setCellPadding(5)
                style.setBorderBrush(self.palette().brush(QPalette.ColorRole.Light))
                frame.setFormat(style)

    def _mark_current(self) -> None:
        for row in range(self.list.count()):
            section: Section = self.list.item(row).data(_SECTION)
            if section.page == self.page:
                with QSignalBlocker(self.list):
                    self.list.setCurrentRow(row)
                return

    def _fill(self, words: str) -> None:
        found = find(words) if words.strip() else [page.sections[0] for page in help_pages()]
        titles = {page.name: page.title for page in help_pages()}
        with QSignalBlocker(self.list):
            self.list.clear()
            for section in found:
                title = titles[section.page]
                item = QListWidgetItem(title if section.title in ("", title) else f"{section.title}\n  {title}")
                item.setData(_SECTION, section)
                self.list.addItem(item)
            if not found:
                item = QListWidgetItem("No help page contains these words.")
                item.setFlags(Qt.ItemFlag.NoItemFlags)
                self.list.addItem(item)
        if words.strip() and found:
            self.list.setCurrentRow(0)
        elif not words.strip():
            self._mark_current()
        self._highlight()

    def _on_current(self, item: QListWidgetItem | None) -> None:
        section: Section | None = None if item is None else item.data(_SECTION)
        if section is not None:
            self.show_page(section.page, section.title if self.search.text() else "")

    def _highlight(self) -> None:
        """Highlights the search words in the page."""
        marks: list[QTextEdit.ExtraSelection] = []
        style = QTextCharFormat()
        style.setBackground(self.palette().color(QPalette.ColorRole.Highlight))
        style.setForeground(self.palette().color(QPalette.ColorRole.HighlightedText))
        for word in self.search.text().split():
            cursor = self.text.document().find(word)
            while not cursor.isNull() and len(marks) < 500:
                mark = QTextEdit.ExtraSelection()
                mark.cursor, mark.format = cursor, style
                marks.append(mark)
                cursor = self.text.document().find(word, cursor)
        self.text.setExtraSelections(marks)


def open_help(page: str, parent: QWidget) -> HelpWindow:
    """Shows a page in the open help window, or in a new one."""
    for window in parent.findChildren(HelpWindow):
        if window.isVisible():
            window.search.clear()
            window.show_page(page)
            window.raise_()
            window.activateWindow()
            return window
    window = HelpWindow(page, parent)
    show_and_focus(window)
    return window
