"""Stores an edited graph on disk: each step in a journal, the graph in its file when the user saves."""

from __future__ import annotations

import threading

from PySide6.QtCore import QObject, QTimer, Signal

from nvsim.errors import InputError
from nvsim.graph.history import History
from nvsim.graph.journal import Journal
from nvsim.graph.types import NavGraph
from nvsim.plain_text import count_text
from nvsim_app.state.graph_files import GraphFile

LOOK = 1200  # milliseconds after a step until the journal is checked for write errors


class GraphSaving(QObject):
    """Manages the journal and the saving of a graph. notified(str): a notice for the user. failed(str): an error of
    reading or writing. saved(): the graph was written."""

    notified = Signal(str)
    failed = Signal(str)
    saved = Signal()
    _saved = Signal(object, str)  # from the saving thread: (history, graph, notice), error

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._journal: Journal | None = None
        self._history: History | None = None
        self._saver: threading.Thread | None = None
        self._saving = False
        self._trouble = ""
        self._look = QTimer(self, singleShot=True, interval=LOOK)
        self._look.timeout.connect(self._look_at_disk)
        self._saved.connect(self._on_saved)

    def open(self, graph: NavGraph, file: GraphFile | None) -> tuple[History, str]:
        """The history with the restored steps of the journal, and why the graph cannot be edited ("" if it can)."""
        self._history, locked = History(graph), ""
        if file is not None and file.journal is not None:
            try:
                self._journal = Journal.open(file.journal, plain=file.foreign)
                self._history = self._journal.history(graph)
            except InputError as error:
                self._journal = None
                self.failed.emit(f"{error} After a crash, edits cannot be restored.")
                return self._history, ""
            locked = self._journal.refusal or ""
            if locked:
                self.notified.emit(locked)
            if self._journal.notice and self._journal.notice != locked:
                self.notified.emit(self._journal.notice)
            if self._journal.recovered and not locked:
                count = self._journal.recovered
                were, them = ("was", "it") if count == 1 else ("were", "them")
                self.notified.emit(
                    f"{count_text(count, 'unsaved edit')} {were} restored; the history lists {them}, and you can undo "
                    f"{them} there."
                )
        return self._history, locked

    def close(self) -> None:
        """Waits for a save in progress, and closes the journal. All edits are on disk when this returns."""
        if self._saver is not None:
            self._saver.join()
        if self._journal is not None:
            try:
                self._journal.close()
            except InputError as error:
                self.failed.emit(str(error))
        self._journal, self._history = None, None

    def look_soon(self) -> None:
        """Schedules a check whether the journal could write the last step."""
        self._look.start()

    def _look_at_disk(self) -> None:
        """Reports an error of the journal once."""
        trouble = "" if self._journal is None else self._journal.trouble
        if trouble and trouble != self._trouble:
            self.failed.emit(trouble)
        self._trouble = trouble

    def save(self, history: History, file: GraphFile, wait: bool = False) -> None:
        """Writes the graph to its file in a thread. With `wait`, returns after writing."""
        if self._saving:
            return
        graph, journal = history.graph, self._journal
        self._saving = True

        def work() -> None:
            trouble = words = ""
            try:
                if journal is not None:
                    journal.flush()  # so that the journal matches the file after a crash
                words = file.save(graph)
            except InputError as error:
                trouble = str(error)
            self._saved.emit((history, graph, words), trouble)

        self._saver = threading.Thread(target=work, name="graph saver")
        self._saver.start()
        if wait:
            self._saver.join()

    def _on_saved(self, what: tuple[History, NavGraph, str], trouble: str) -> None:
        history, graph, words = what
        self._saving = False
        if trouble:
            self.failed.emit(trouble)
        elif history is self._history:
            history.mark_saved(graph)
            self.saved.emit()
            if words:
                self.notified.emit(words)
            if not history.is_saved:
                self.notified.emit("The graph was saved; edits that you made during saving are not saved yet.")
