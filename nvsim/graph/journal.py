"""The journal of a graph: its history of edits on disk. Every step is on disk within half a second and survives a
killed process.

A SQLite file holds the first graph and, for every step, the values that changed. A separate thread writes all new steps
in one transaction, so that editing never waits for the disk. The journal of a project is in the project folder and
keeps the last thousand steps. The journal of a foreign file is hidden beside it, and is deleted after the file was
saved and closed.
"""

from __future__ import annotations

import sqlite3
import struct
import threading
import zlib
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files.databases import check_files
from nvsim.files.locking import AlreadyLocked, WriterLock
from nvsim.graph.difference import GraphDelta, check_steps
from nvsim.graph.graph_cache import GraphCache
from nvsim.graph.history import History, Step
from nvsim.graph.journal_file import JournalContent, JournalFile, NewerJournal
from nvsim.graph.journal_rows import encode_delta, encode_selection, fingerprint
from nvsim.graph.selection import NOTHING, existing_part
from nvsim.graph.types import NavGraph

KEPT_STEPS = 1000
"""Maximum number of steps after a journal is opened or closed. Older steps become part of its first graph."""
KEPT_BYTES = 64 << 20
"""Maximum size of the stored steps in bytes. At least the last step is kept."""
_PERIOD = 0.4  # seconds between a step and its write
_UNHEARD = 8  # number of last steps in which a saved graph is searched
OUTSIDE = "Changed outside the editor"


def sidecar(path: Path) -> Path:
    """Return the path of the hidden history file beside a foreign file."""
    return path.parent / f".{path.name}.edits"


class Journal:
    """Records a history on disk. Only one process at a time can write.

    path       the SQLite file
    refusal    why this process cannot edit; None if it can
    busy       whether another process edits
    notice     message about the opening, for users; "" for none
    trouble    message of the last failed write, "" if all writes succeeded; unwritten steps are kept and written later
    recovered  number of recorded edits that the graph file does not contain
    """

    def __init__(self, path: Path, lock: WriterLock | None, refusal: str | None, plain: bool) -> None:
        self.path = path
        self.refusal = refusal
        self.busy = False
        self.notice = refusal or ""
        self.trouble = ""
        self.recovered = 0
        self._plain = plain
        self._lock = lock
        self._file = JournalFile(path, read_only=refusal is not None)
        self._history: History | None = None
        self._state = threading.Lock()  # guards the pending steps
        self._writing = threading.Lock()  # held while the file is written
        self._wake = threading.Event()
        self._writer: threading.Thread | None = None
        self._closed = False
        self._pending: dict[int, tuple[Step, GraphDelta | None]] = {}
        self._cut: int | None = None
        self._marks: dict[str, Any] = {}
        self._base: NavGraph | None = None  # to be written with the first step

    @staticmethod
    def open(path: Path, *, plain: bool = False) -> Journal:
        """Open the journal at `path`; its first step creates the file. `plain`: the file that it belongs to holds only
        the content of an R2R connectivity file.

        If the journal cannot be written safely, it is opened read-only and `refusal` gives the reason. Raises
        InputError if `path`, or a file that SQLite keeps beside it, is not a regular file.
        """
        check_files(path)
        lock_path = path.with_name(f"{path.name}.lock")
        name = path.parent.name if not plain else path.name.removeprefix(".").removesuffix(".edits")
        try:
            return Journal(path, WriterLock(lock_path), None, plain)
        except AlreadyLocked:
            why, busy = "is being edited in another window; here it", True
        except InputError as error:
            why, busy = f"cannot be edited ({str(error).rstrip('.')}); it", False
        journal = Journal(path, None, f"{name} {why} is read-only.", plain)
        journal.busy = busy
        return journal

    def history(self, graph: NavGraph) -> History:
        """Return the recorded history, continued from `graph`, the current content of the graph file. Call this once.

        - `recovered` counts the edits that were not saved.
        - If another program changed the file, a step OUTSIDE is added.
        - A damaged journal is renamed, and `notice` reports this.

        Raises InputError if a newer version of NVSim wrote the journal.
        """
        written = self._read()
        if written is None:
            self._base = graph
            self._history = History(graph, self)
            return self._history
        graphs = GraphCache(written.base, [delta for _, delta in written.steps])
        # Stored selections were valid when they were made. A graph from outside may lack some of their elements.
        steps = [
            Step("Opened", existing_part(graph, NOTHING), written.begun, edit=False),
            *(s for s, _ in written.steps),
        ]
        history = History.restored(graphs, steps, written.index, written.clean, self)
        self._history = history
        mine = fingerprint(graph, plain=self._plain)
        if mine == written.saved:
            self.recovered = history.edits_since_saved()
        elif self.refusal is None and (held := self._saved_unheard(history, mine)) is not None:
            history.mark_saved(held)
            self.recovered = history.edits_since_saved()
        elif self.refusal is None:
            self.recovered = history.edits_since_saved()
            history.replace_from_outside(OUTSIDE, graph)
        elif mine != fingerprint(history.graph, plain=self._plain):
            return History(graph, self)
        return history

    def _saved_unheard(self, history: History, mine: str) -> NavGraph | None:
        """Return the graph of one of the last steps if it equals the content of the file. Such a graph was saved, but
        the process died before it recorded this."""
        for index in range(history.index, max(-1, history.index - _UNHEARD), -1):
            graph = history.graph_at(index)
            if fingerprint(graph, plain=self._plain) == mine:
                return graph
        return None

    # Called by the history -----------------------------------------------------------------------------------------

    def record_step(self, index: int, step: Step, delta: GraphDelta) -> None:
        """Record step `index` (1 and up) with its delta from the previous step. Later steps are removed."""
        with self._state:
            for later in [i for i in self._pending if i >= index]:
                del self._pending[later]
            self._cut = index if self._cut is None else min(self._cut, index)
            self._pending[index] = (step, delta)
        self._begin()

    def amend(self, index: int, step: Step) -> None:
        """Replace the selection of step `index`."""
        with self._state:
            delta = self._pending[index][1] if index in self._pending else None
            if index:
                self._pending[index] = (step, delta)
        self._begin()

    def move(self, index: int, clean: int) -> None:
        """Record the current step and the saved step (-1: none)."""
        with self._state:
            self._marks |= {"index": index, "clean": clean}
        self._begin()

    def saved(self, graph: NavGraph) -> None:
        """Record that the file holds this graph."""
        with self._state:
            self._marks["saved"] = graph
        self._begin()

    # Writing ----------------------------------------------------------------------------------------------------

    def flush(self) -> None:
        """Write all pending steps to disk. Raises InputError if writing fails; the steps are kept then."""
        with self._writing:
            with self._state:
                pending, cut, marks, base = self._pending, self._cut, self._marks, self._base
                self._pending, self._cut, self._marks = {}, None, {}
            # Create no file if the user changed nothing.
            if not self._file.exists and not any(step.changes for step, _ in pending.values()):
                self._keep(pending, cut, marks)
                return
            if not pending and not marks:
                return
            try:
                if base is not None and not self._file.exists:
                    self._file.create(base, fingerprint(base, plain=self._plain))
                rows = [
                    (index, step, encode_selection(step.selection), None if delta is None else encode_delta(delta))
                    for index, (step, delta) in sorted(pending.items())
                ]
                if isinstance(marks.get("saved"), NavGraph):
                    marks = marks | {"saved": fingerprint(marks["saved"], plain=self._plain)}
                self._file.write(cut, rows, marks)
            except BaseException as error:
                self._keep(pending, cut, marks)
                self.trouble = str(error)
                raise
            self.trouble = ""
            self._base = None

    def close(self) -> None:
        """Write the pending steps and release the lock. The journal of a saved foreign file is deleted. Raises
        InputError if writing fails; the unwritten edits are lost then."""
        if self._closed:
            return
        self._closed = True
        self._wake.set()
        if self._writer is not None:
            self._writer.join()
        try:
            if self.refusal is None:
                self.flush()
                if not self._is_deleted_on_close:
                    self._file.trim(KEPT_STEPS, KEPT_BYTES)
        finally:
            self._file.close()
            if self._lock is not None:
                if self._is_deleted_on_close:
                    self._file.remove()
                self._lock_path.unlink(missing_ok=True)
                self._lock.release()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _is_deleted_on_close(self) -> bool:
        """Whether closing deletes the journal."""
        return self._plain and (self._history is None or self._history.is_saved)

    @property
    def _lock_path(self) -> Path:
        return self.path.with_name(f"{self.path.name}.lock")

    def _keep(self, pending: dict[int, tuple[Step, GraphDelta | None]], cut: int | None, marks: dict[str, Any]) -> None:
        """Put unwritten steps back, below newer ones."""
        with self._state:
            newer = self._cut
            kept = {i: row for i, row in pending.items() if newer is None or i < newer}
            self._pending = kept | self._pending
            cuts = [c for c in (cut, newer) if c is not None]
            self._cut = min(cuts) if cuts else None
            self._marks = marks | self._marks

    def _begin(self) -> None:
        if self.refusal is None and not self._closed and (self._writer is None or not self._writer.is_alive()):
            self._writer = threading.Thread(target=self._write_on, name="journal", daemon=True)
            self._writer.start()

    def _write_on(self) -> None:
        """Write until no new steps arrive. Then the thread ends."""
        while not self._wake.wait(_PERIOD):
            try:
                self.flush()
            except InputError:
                continue  # `trouble` holds the message; the next round tries again
            with self._state:
                if not self._pending and not self._marks or not self._file.exists:
                    self._writer = None
                    return

    def _trim(self) -> None:
        try:
            self._file.trim(KEPT_STEPS, KEPT_BYTES)
        except InputError as error:
            self.trouble = str(error)  # the journal keeps its length; the next step reports a full disk as well

    def _read(self) -> JournalContent | None:
        try:
            if self.refusal is None:
                self._trim()
            written = self._file.read()
            if written is not None:
                check_steps(written.base, (delta for _, delta in written.steps))
            return written
        except NewerJournal:
            raise
        except (
            *(InputError, sqlite3.Error, ValueError, KeyError, TypeError, IndexError, EOFError),
            *(AttributeError, RecursionError, OverflowError, struct.error, zlib.error),
        ) as error:
            if self.refusal is not None:
                return None
            aside = self._file.set_aside()
            self.notice = f"The history of edits is damaged ({error}); it was renamed to {aside.name}."
            return None
