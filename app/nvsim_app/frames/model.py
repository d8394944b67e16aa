"""The frames as rows of a list, a filter for them, and their thumbnails, which are loaded when a list
first needs them."""

from __future__ import annotations

import time
from collections import OrderedDict
from pathlib import Path
from typing import Any

from PySide6.QtCore import (
    QAbstractListModel,
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    QSortFilterProxyModel,
    Qt,
    QTimer,
    Signal,
)
from PySide6.QtGui import QPixmap

from nvsim.project.layout import Layout
from nvsim_app.frames.link import FrameLink
from nvsim_app.frames.state import FrameState
from nvsim_app.frames.worker import thumbnail_path
from nvsim_app.look.plain_text import plain, tooltip_text
from nvsim_app.state.document import Document

_MOST = 600  # maximum number of pixmaps in the cache
_SLICE = 0.004  # seconds of loading per iteration of the event loop


class Thumbnails(QObject):
    """A cache of thumbnails. changed(int): the thumbnail of this frame is available."""

    changed = Signal(int)

    def __init__(self, document: Document, link: FrameLink, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document, self._link = document, link
        self._kept: OrderedDict[int, QPixmap] = OrderedDict()
        self._wanted: list[int] = []  # the most recently painted is loaded first
        self._missing: list[int] = []
        self._hopeless: set[int] = set()
        self._load = QTimer(self, singleShot=True, interval=0)
        self._load.timeout.connect(self._load_some)
        # Scrolling requests many thumbnails. The delay collects them, and only the newest are requested.
        self._ask = QTimer(self, singleShot=True, interval=40)
        self._ask.timeout.connect(self._ask_for_missing)
        link.thumbnailMade.connect(self._on_made)
        link.failed.connect(self._on_failed)

    def clear(self) -> None:
        """Empties the cache, because the frames changed."""
        self._kept.clear()
        self._wanted, self._missing = [], []
        self._hopeless.clear()

    def pixmap(self, frame: int) -> QPixmap | None:
        """The thumbnail, or None while it is loaded; `changed` is emitted when it is available."""
        found = self._kept.get(frame)
        if found is not None:
            self._kept.move_to_end(frame)
            return found
        if frame not in self._hopeless and frame not in self._wanted:
            self._wanted.append(frame)
            del self._wanted[:-200]
            self._load.start()
        return None

    def _load_some(self) -> None:
        end = time.perf_counter() + _SLICE
        capture, root = self._document.contents.capture, self._document.path
        while self._wanted and capture is not None and root is not None:
            frame = self._wanted.pop()
            if frame < len(capture.frames):
                path = thumbnail_path(Layout(root), capture.frames[frame].image_path)
                if not self._store_thumbnail(frame, path) and frame not in self._missing:
                    self._missing.append(frame)
                    self._ask.start()
            if time.perf_counter() > end:
                self._load.start()
                return

    def _store_thumbnail(self, frame: int, path: Path) -> bool:
        pixmap = QPixmap(str(path))
        if pixmap.isNull():
            return False
        self._kept[frame] = pixmap
        while len(self._kept) > _MOST:
            self._kept.popitem(last=False)
        self.changed.emit(frame)
        return True

    def _ask_for_missing(self) -> None:
        newest, self._missing = self._missing[-60:][::-1], []
        self._link.ask_thumbnails(newest)

    def _on_made(self, frame: int, file: str) -> None:
        if not self._store_thumbnail(frame, Path(file)):
            self._hopeless.add(frame)

    def _on_failed(self, what: str, frame: int, sentence: str) -> None:
        if what == "thumbnail":
            self._hopeless.add(frame)


_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()
COVERAGE_ROLE = Qt.ItemDataRole.UserRole + 1
CORRECTED_ROLE = Qt.ItemDataRole.UserRole + 2
SUBMAP_ROLE = Qt.ItemDataRole.UserRole + 3
HELD_OUT_ROLE = Qt.ItemDataRole.UserRole + 4
SCORE_ROLE = Qt.ItemDataRole.UserRole + 5
MASK_ROLE = Qt.ItemDataRole.UserRole + 6

KINDS: tuple[tuple[str, str], ...] = (
    ("All frames", ""),
    ("Held out", "held out"),
    ("Trained on", "trained on"),
    ("Corrected", "corrected"),
)
"""Label, and argument of `FrameFilter.show_kind`."""
ORDERS: tuple[tuple[str, str], ...] = (
    ("In order", ""),
    ("Worst PSNR", "psnr"),
    ("Worst SSIM", "ssim"),
)
"""Label, and name of the score by which the list is sorted in ascending order; "" for the order of the capture."""

COVERAGES: tuple[tuple[str, float, float], ...] = (
    ("Any floor", -1.0, 2.0),
    ("No floor", -0.5, 0.0005),
    ("Up to 10 % floor", 0.0005, 0.1),
    ("10 to 30 % floor", 0.1, 0.3),
    ("Over 30 % floor", 0.3, 2.0),
)
"""Label and range of the floor share: above the first and up to the second number. Unknown shares count as -1."""


class FrameModel(QAbstractListModel):
    """A row for each frame of the capture: name, thumbnail, submap, floor share, whether it is corrected or held out,
    and its scores."""

    def __init__(
        self, document: Document, thumbnails: Thumbnails, state: FrameState, parent: QObject | None = None
    ) -> None:
        super().__init__(parent)
        self._document, self._thumbnails, self._state = document, thumbnails, state
        document.contentsChanged.connect(self._on_contents)
        thumbnails.changed.connect(self._on_thumbnail)
        state.changed.connect(self._on_state)

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "capture" in parts:
            self.beginResetModel()
            self._thumbnails.clear()
            self.endResetModel()
        elif "submaps" in parts:
            self._on_state(0, self.rowCount() - 1)

    def _on_thumbnail(self, frame: int) -> None:
        index = self.index(frame)
        self.dataChanged.emit(index, index, [Qt.ItemDataRole.DecorationRole])

    def _on_state(self, first: int, last: int) -> None:
        last = min(last, self.rowCount() - 1)
        if first <= last:
            roles = [COVERAGE_ROLE, MASK_ROLE, CORRECTED_ROLE, SUBMAP_ROLE, HELD_OUT_ROLE, SCORE_ROLE]
            self.dataChanged.emit(self.index(first), self.index(last), roles)

    def rowCount(self, parent: _Index = _ROOT) -> int:
        capture = self._document.contents.capture
        return 0 if parent.isValid() or capture is None else len(capture.frames)

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        capture = self._document.contents.capture
        if capture is None or not index.isValid() or index.row() >= len(capture.frames):
            return None
        row = index.row()
        if role == Qt.ItemDataRole.DisplayRole:
            return plain(capture.frames[row].name)
        if role == Qt.ItemDataRole.DecorationRole:
            return self._thumbnails.pixmap(row)
        if role == COVERAGE_ROLE:
            return self._state.coverage.get(row, -1.0)
        if role == MASK_ROLE:
            return mask_words(self._state, row)
        if role == CORRECTED_ROLE:
            return row in self._state.corrected
        if role == HELD_OUT_ROLE:
            return row in self._state.held_out
        if role == SCORE_ROLE:
            return self._state.score(row)
        if role == SUBMAP_ROLE:
            return int(self._document.trajectory.submaps[row])
        if role == Qt.ItemDataRole.ToolTipRole:
            return tooltip_text(f"{plain(capture.frames[row].image_path)}\n{frame_words(self._state, row)}")
        return None


def mask_words(state: FrameState, frame: int) -> str:
    """The floor share of a frame as text, for example "23 % floor"."""
    share = state.coverage.get(frame)
    if share is not None:
        return f"{100 * share:.0f} % floor"
    return "reading masks…" if state.reading else "no mask yet"


def coverage_words(state: FrameState, frame: int) -> str:
    """The floor share of a frame as text, for example "23 % floor, corrected by hand"."""
    words = mask_words(state, frame)
    return f"{words}, corrected by hand" if frame in state.corrected else words


def frame_words(state: FrameState, frame: int) -> str:
    """The state of a frame as text, for example "23 % floor, held out: PSNR 24.1 dB, SSIM 0.83"."""
    words = coverage_words(state, frame)
    if frame not in state.held_out:
        return words
    score = state.score(frame)
    if score is None:
        return f"{words}, held out of training"
    return f"{words}, held out: {score.words}{' of earlier models' if state.outdated else ''}"


class FrameFilter(QSortFilterProxyModel):
    """Filters frames by name, submap (including frames shared with neighbors), floor share, correction, and held-out
    state. The order is that of the capture, or the worst score first."""

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._text = ""
        self._submap: int | None = None
        self._members: frozenset[int] = frozenset()
        self._coverage = COVERAGES[0][1:]
        self._kind = ""
        self._by = ""
        self.setSortRole(SCORE_ROLE)
        document.contentsChanged.connect(self._on_contents)

    def show_name(self, text: str) -> None:
        self._text = text.casefold()
        self.invalidate()

    def show_submap(self, submap: int | None) -> None:
        """Shows the frames of a submap; None shows all."""
        self._submap = submap
        self._members = frozenset(
            frame for s in self._document.contents.submaps if s.index == submap for frame in s.frames
        )
        self.invalidate()

    def show_coverage(self, above: float, up_to: float) -> None:
        self._coverage = (above, up_to)
        self.invalidate()

    def show_kind(self, kind: str) -> None:
        """Shows one kind of frames from KINDS; "" shows all."""
        self._kind = kind
        self.invalidate()

    def show_order(self, by: str) -> None:
        """Sorts by one of the scores in ORDERS, the lowest first, frames without a score last; "" restores the order of
        the capture."""
        self._by = by
        self.invalidate()
        self.sort(0 if by else -1)

    def lessThan(self, left: _Index, right: _Index) -> bool:
        return self._rank(left) < self._rank(right)

    def _rank(self, index: _Index) -> tuple[float, int]:
        score = index.data(SCORE_ROLE)
        return (float("inf") if score is None else getattr(score, self._by), index.row())

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "submaps" in parts and self._submap is not None:
            self.show_submap(self._submap)

    def filterAcceptsRow(self, row: int, parent: _Index) -> bool:
        anything = (self._coverage == COVERAGES[0][1:]) and not self._kind and not self._text
        if anything and self._submap is None:
            return True
        index = self.sourceModel().index(row, 0)
        if self._submap is not None and row not in self._members:
            return False
        if self._kind == "corrected" and not index.data(CORRECTED_ROLE):
            return False
        if self._kind in ("held out", "trained on") and (self._kind == "held out") != index.data(HELD_OUT_ROLE):
            return False
        above, up_to = self._coverage
        if (above, up_to) != COVERAGES[0][1:] and not above < float(index.data(COVERAGE_ROLE)) <= up_to:
            return False
        capture = self._document.contents.capture
        return capture is not None and self._text in capture.frames[row].name.casefold()
