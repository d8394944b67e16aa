"""Malicious texts: as markup, they would read a file, break a layout or mislead. And the rules for the text that the
window may show."""

from __future__ import annotations

import errno
import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import demo_room
import pyqtgraph
from PySide6.QtCore import QAbstractItemModel, QAbstractListModel, QAbstractTableModel, QModelIndex, QObject, Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QComboBox,
    QGraphicsTextItem,
    QGraphicsView,
    QLabel,
    QLineEdit,
    QPlainTextEdit,
    QTabBar,
    QTextEdit,
    QWidget,
)

from nvsim.graph.types import NavGraph, edge
from nvsim_app.look.labels import MarkedLabel
from nvsim_app.panels.help import HelpWindow
from nvsim_app.state.loading import Contents

EVIL = "EVIL"  # stands in every text from outside
LONGEST = 2100  # characters of anything that is shown
_RICH = re.compile(r"<\s*([a-z!?][^\s/>]*)", re.IGNORECASE)
_UNSEEN = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
_SINGLE = re.compile(r"(?<!&)(?:&&)*&(?!&)")
ROLE = Qt.ItemDataRole


@contextmanager
def trap(path: Path) -> Iterator[list[str]]:
    """A FIFO. The list gets an entry when a process opens the FIFO for reading; the reader then gets an empty file."""
    os.mkfifo(path)
    opened: list[str] = []
    over = threading.Event()

    def watch() -> None:
        while not over.wait(0.002):
            try:
                os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))
                opened.append("somebody reads the file that a text names")
            except OSError as error:
                assert error.errno == errno.ENXIO

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield opened
    finally:
        over.set()
        thread.join()


def text(fifo: Path, number: int = 0, long: bool = False) -> str:
    """`number` makes it one of its own, `long` a hundred thousand letters."""
    markup = f'{EVIL}{number} <img src="{fifo}"><b>bold</b><table background="{fifo}">'
    return f"{markup}&amp; &x \u202egpj.\t\x07\nnext\u2028line [*]{'x' * 100_000 if long else ''}"


def graph_of(fifo: Path, plain: NavGraph) -> NavGraph:
    """The same with such identifiers, origins, decisions and scan."""
    ids = {id: text(fifo, i, long=i == 3) for i, id in enumerate(plain.viewpoints)}
    viewpoints = {ids[id]: replace(v, id=ids[id], origin=text(fifo)) for id, v in plain.viewpoints.items()}
    edges = [replace(edge(ids[a], ids[b]), origin=text(fifo)) for a, b in plain.edges]
    evidence = {
        (ids[id], direction): replace(e, viewpoint=ids[id], decision=e.decision if direction % 3 else text(fifo))
        for (id, direction), e in plain.evidence.items()
    }
    return NavGraph(text(fifo), viewpoints, {e.key: e for e in edges}, evidence)


def contents(fifo: Path, project: Path) -> Contents:
    """The demo room, every name of which is such a text."""
    room = demo_room.contents(project)
    assert room.capture is not None and room.graph is not None
    frames = tuple(
        replace(f, name=text(fifo, i, long=i == 0), image_path=fifo.parent / text(fifo, i))
        for i, f in enumerate(room.capture.frames)
    )
    info = {i: {"psnr": 30.0, text(fifo): text(fifo, long=True), "scene": text(fifo)} for i in range(3)}
    return replace(
        room,
        capture=replace(room.capture, frames=frames, format=text(fifo)),
        graph=graph_of(fifo, room.graph),
        model_info=info,
    )


def faults(root: QWidget) -> list[str]:
    """Texts in the window, its menus and its lists that are parsed as markup, mislead, or are too long."""
    found: list[str] = []
    for thing in [root, *root.findChildren(QObject)]:
        where = f"{type(thing).__name__} {thing.objectName()}"
        if isinstance(thing, QAction):
            found += [f"{where}: {f}" for f in _of_action(thing)]
        if isinstance(thing, QWidget):
            found += [f"{where}: {f}" for f in _of_widget(thing)]
    return list(dict.fromkeys(found))


def _of_action(action: QAction) -> list[str]:
    found = _of_tip(action.toolTip()) + _of_tip(action.whatsThis()) + _of_words(action.statusTip())
    return found + _of_words(action.text()) + _of_mnemonic(action.text())


def _of_widget(widget: QWidget) -> list[str]:
    found = _of_tip(widget.toolTip()) + _of_tip(widget.whatsThis()) + _of_words(widget.statusTip())
    found += _of_words(widget.windowTitle())
    if isinstance(widget, QLabel):
        found += _of_label(widget)
    if isinstance(widget, QAbstractButton):
        found += _of_words(widget.text()) + _of_mnemonic(widget.text())
    if isinstance(widget, QLineEdit) and widget.isReadOnly():
        found += _of_words(widget.text())
    if isinstance(widget, QTabBar):
        for i in range(widget.count()):
            found += _of_words(widget.tabText(i)) + _of_tip(widget.tabToolTip(i)) + _of_mnemonic(widget.tabText(i))
    if isinstance(widget, QTextEdit) and not isinstance(widget.window(), HelpWindow):
        found.append("a document outside of the help")
    if isinstance(widget, QPlainTextEdit):
        found += _of_document(widget.document().toHtml(), widget.toPlainText())
    if isinstance(widget, QGraphicsView) and widget.scene() is not None:
        for item in widget.scene().items():
            if isinstance(item, QGraphicsTextItem):
                found += _of_document(item.toHtml(), item.toPlainText())
            if isinstance(item, pyqtgraph.AxisItem):
                found += [f for level in item._tickLevels or () for _, words in level for f in _of_words(str(words))]
    if isinstance(widget, QAbstractItemView | QComboBox) and widget.model() is not None:
        found += _of_model(widget.model(), QModelIndex())
    return found


def _of_label(label: QLabel) -> list[str]:
    if label.textFormat() == Qt.TextFormat.PlainText:
        return _of_words(label.text())
    rich = label.textFormat() != Qt.TextFormat.AutoText or _RICH.search(label.text())
    if not rich:
        return _of_words(label.text())
    if not isinstance(label, MarkedLabel):
        return ["a label that is not plain"]
    return _of_document(label.text(), "")


def _of_model(model: QAbstractItemModel, parent: QModelIndex) -> list[str]:
    found: list[str] = []
    # Columns of a list and children of a table are private.
    columns = 1 if isinstance(model, QAbstractListModel) else model.columnCount(parent)
    tree = not isinstance(model, QAbstractListModel | QAbstractTableModel)
    for column in range(columns):
        for way in (Qt.Orientation.Horizontal, Qt.Orientation.Vertical):
            found += _of_words(model.headerData(column, way, ROLE.DisplayRole))
            found += _of_tip(model.headerData(column, way, ROLE.ToolTipRole))
        for row in range(model.rowCount(parent)):
            index = model.index(row, column, parent)
            found += _of_words(index.data(ROLE.DisplayRole)) + _of_words(index.data(ROLE.StatusTipRole))
            found += _of_tip(index.data(ROLE.ToolTipRole)) + _of_tip(index.data(ROLE.WhatsThisRole))
            if tree and column == 0 and model.hasChildren(index):
                found += _of_model(model, index)
    return found


def _of_tip(words: object) -> list[str]:
    shown = "" if words is None else str(words)
    tags = {t.lower() for t in _RICH.findall(shown)}
    return _of_words(re.sub(r"<br>|</?span[^>]*>", "", shown), tags - {"span", "br"})


def _of_words(words: object, tags: set[str] | None = None) -> list[str]:
    shown = "" if words is None else str(words)
    found = [f"tags {sorted(tags)} in {shown[:80]!a}"] if tags else []
    if _UNSEEN.search(shown):
        found.append(f"unseen letters in {shown[:300]!a}")
    if len(shown) > 2 * LONGEST:
        found.append(f"{len(shown)} letters: {shown[:80]!a}")
    return found


def _of_document(markup: str, words: str) -> list[str]:
    found = [f"a picture in {markup[:80]!a}"] if "<img" in markup or "\ufffc" in words else []
    return found + ([f"a background in {markup[:80]!a}"] if re.search(r"<[^>]*(background=|url\()", markup) else [])


def _of_mnemonic(words: str) -> list[str]:
    """Our own & stands before the text from outside."""
    outside = words[words.find(EVIL) :] if EVIL in words else ""
    return [f"a letter is taken for a shortcut: {words[:80]!a}"] if _SINGLE.search(outside) or "\t" in outside else []
