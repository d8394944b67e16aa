"""The thumbnails of frames, which are loaded when a list first needs them."""

from __future__ import annotations

import time
from collections import OrderedDict
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal
from PySide6.QtGui import QPixmap

from nvsim.project.layout import Layout
from nvsim_app.frames.link import FrameLink
from nvsim_app.frames.worker import thumbnail_path
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
                path = thumbnail_path(Layout(root), capture.frames[frame])
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
