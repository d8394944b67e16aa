"""One window that shows one project after another: the document, the thread that updates it, and the 3D scene."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QObject, QSettings, QTimer

from nvsim.project.path_kind import GRAPHS, check_openable, path_kind
from nvsim.splats.turning import UPS
from nvsim_app.drawing.render_child import ProjectSource
from nvsim_app.look.notices import Notices
from nvsim_app.panels.preferences import memory_budget
from nvsim_app.processes.background import BackgroundWork
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.state.opened_files import GraphSource, SplatFile
from nvsim_app.state.watcher import ProjectWatcher
from nvsim_app.wiring.window import MainWindow


class Session(QObject):
    """Owns the window, the document, and the reader of the open project or file."""

    def __init__(self, settings: QSettings) -> None:
        super().__init__()
        self.notices = Notices(self)
        self.document = Document(parent=self)
        self.window = MainWindow(self.document, settings, self.notices)
        self._watcher: ProjectWatcher | BackgroundWork | None = None
        self._arrived: deque[Contents] = deque()
        # Parts that were read together are shown one at a time, so that the event loop runs in between.
        self._next = QTimer(self, singleShot=True, interval=1)
        self._next.timeout.connect(self._show_next)
        self.window.projectChosen.connect(self._on_chosen)
        self.window.refreshWanted.connect(self._refresh)
        self.window.closeWanted.connect(self.close_project)
        self.window.turnWanted.connect(self._turn_up)
        self.document.contentsChanged.connect(self._on_contents)
        self.window.preferences.changed.connect(self._on_preference)

    def open(self, path: Path) -> None:
        """Watches a project folder, or reads a file once. The caller has checked the path."""
        if path_kind(path) in GRAPHS:
            with self.notices.reporting():
                self._read_once(GraphSource(path))
            return
        if path.is_file():
            self._read_once(SplatFile.of(path))
            return
        self._stop_watching()
        self.window.scene.feed.show(None)
        self.document.set_contents(Contents(path, reading=True))
        self._watcher = ProjectWatcher(path, self)
        self._watcher.read.connect(self._on_read)
        self._watcher.failed.connect(self._on_failed)
        self._watcher.start()

    def close_project(self) -> None:
        """Closes the project or file; the window stays open."""
        self._stop_watching()
        self.window.scene.feed.show(None)
        self.document.set_contents(Contents())

    def _read_once(self, file: SplatFile | GraphSource) -> None:
        self._stop_watching()
        self.window.scene.feed.show(None)
        self.document.set_contents(Contents(file.path, reading=True))
        self._watcher = BackgroundWork("file reader", self)
        self._watcher.start(file.contents, self._on_read, self._on_failed)

    def _turn_up(self) -> None:
        stamp = self.document.contents.scene_stamp
        if isinstance(stamp, SplatFile):
            following = UPS[(UPS.index(stamp.up) + 1) % len(UPS)]
            self._read_once(replace(stamp, up=following))

    def close(self) -> None:
        """Stops every thread and process, and closes the window."""
        self._stop_watching()
        self.window.close()
        self.document.editing.close()

    def _stop_watching(self) -> None:
        if self._watcher is not None:
            self._watcher.stop()
            self._arrived.clear()
            self._watcher.deleteLater()
            self._watcher = None

    def _on_failed(self, sentence: str) -> None:
        self.document.set_contents(replace(self.document.contents, reading=False))
        self.notices.error(sentence, about="read")

    def _on_read(self, contents: Contents) -> None:
        self.notices.resolve("read")
        self._arrived.append(contents)
        self._next.start()

    def _show_next(self) -> None:
        if self._arrived:
            contents = self._arrived.popleft()
            self.document.set_contents(contents)
            for note in contents.notes:
                self.notices.warning(note)
        if self._arrived:
            self._next.start()

    def _refresh(self) -> None:
        feed = self.window.scene.feed
        if feed.source is not None and feed.link.given_up:
            feed.show(feed.source)
        if isinstance(self._watcher, ProjectWatcher):
            self._watcher.refresh()

    def _on_chosen(self, path: Path) -> None:
        with self.notices.reporting():
            check_openable(path)
            self.open(path)

    def _on_contents(self, parts: frozenset[str]) -> None:
        contents = self.document.contents
        if "scene_stamp" in parts and isinstance(contents.scene_stamp, SplatFile):
            self.window.scene.feed.show(contents.scene_stamp)
        elif "scene_stamp" in parts and contents.path is not None:
            source = ProjectSource(contents.path, memory_budget(self.window.preferences))
            self.window.scene.feed.show(source if contents.scene_stamp is not None else None)

    def _on_preference(self, key: str) -> None:
        """Reloads the models with the new memory limit."""
        if key == "memory_gib" and self.document.contents.scene_stamp is not None:
            self._on_contents(frozenset({"scene_stamp"}))
