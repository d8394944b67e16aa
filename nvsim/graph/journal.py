"""The durable history of a graph: every step is on disk within half a second, even when the process is killed.

A SQLite file holds the first graph and, for every step, the values that changed. A thread of its own writes what came
since it last looked, in one transaction, so that nobody who edits waits for the disk. For a project the file lies in
its folder and stays, with the last thousand steps; beside a foreign file it is hidden and goes when the file was saved
and closed.
"""

from __future__ import annotations

import sqlite3
import struct
import threading
import zlib
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files.database_files import check_files
from nvsim.files.locking import Held, WriterLock
from nvsim.graph.delta import Delta
from nvsim.graph.graph_cache import GraphCache
from nvsim.graph.history import History, Step
from nvsim.graph.journal_check import check_steps
from nvsim.graph.journal_file import JournalFile, Newer, Written
from nvsim.graph.journal_rows import encode_delta, encode_selection, fingerprint
from nvsim.graph.selection import NOTHING, present
from nvsim.graph.types import NavGraph

KEPT_STEPS = 1000
"""So many a journal keeps when it is opened and closed, the oldest become part of its first graph."""
KEPT_BYTES = 64 << 20
"""Of what the steps changed; at least the last step is kept."""
_PERIOD = 0.4  # seconds from a step to its writing
_UNHEARD = 8  # steps at the end among which a saved graph is looked for
OUTSIDE = "Changed outside the editor"


def sidecar(path: Path) -> Path:
    """Where the history of a foreign file lies: hidden, beside it."""
    return path.parent / f".{path.name}.edits"


class Journal:
    """One process at a time writes; `refusal` says so to a second one, which may read, or says why nobody can; `busy`
    is whether it is another process. `notice` is what a user should know about the opening, "" for nothing. `trouble`
    is the sentence of the last failed writing, "" when all is well; what could not be written is kept and tried
    again."""

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
        self._state = threading.Lock()  # guards what is pending
        self._writing = threading.Lock()  # held while the file is written
        self._wake = threading.Event()
        self._writer: threading.Thread | None = None
        self._closed = False
        self._pending: dict[int, tuple[Step, Delta | None]] = {}
        self._cut: int | None = None
        self._marks: dict[str, Any] = {}
        self._base: NavGraph | None = None  # to be written with the first step

    @staticmethod
    def open(path: Path, *, plain: bool = False) -> Journal:
        """The journal at `path`, made with its first step. `plain`: the file it belongs to can hold only what an R2R
        connectivity file can. Raises InputError where something else than a database lies there; where it cannot be
        written, or not safely, it refuses and says why."""
        check_files(path)
        lock_path = path.with_name(f"{path.name}.lock")
        name = path.parent.name if not plain else path.name.removeprefix(".").removesuffix(".edits")
        try:
            return Journal(path, WriterLock(lock_path), None, plain)
        except Held:
            why, busy = "is being edited in another window; here it", True
        except InputError as error:
            why, busy = f"cannot be edited ({str(error).rstrip('.')}); it", False
        journal = Journal(path, None, f"{name} {why} can only be looked at.", plain)
        journal.busy = busy
        return journal

    def history(self, graph: NavGraph) -> History:
        """The history that was written down, going on from `graph`, which the file holds now: with `recovered` edits
        that were not saved; with a step OUTSIDE where the file was changed by another program. A damaged journal is set
        aside and said so in `notice`. To be called once. Raises InputError when a newer program wrote it."""
        written = self._read()
        if written is None:
            self._base = graph
            self._history = History(graph, self)
            return self._history
        graphs = GraphCache(written.base, [delta for _, delta in written.steps])
        # Selections were checked when they were made; a graph from outside may have changed under them.
        steps = [Step("Opened", present(graph, NOTHING), written.begun, edit=False), *(s for s, _ in written.steps)]
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
            history.take_over(OUTSIDE, graph)
        elif mine != fingerprint(history.graph, plain=self._plain):
            return History(graph, self)
        return history

    def _saved_unheard(self, history: History, mine: str) -> NavGraph | None:
        """The graph of one of the last steps, where it is what the file holds: it was saved, and the process died
        before it could say so here."""
        for index in range(history.index, max(-1, history.index - _UNHEARD), -1):
            graph = history.graph_at(index)
            if fingerprint(graph, plain=self._plain) == mine:
                return graph
        return None

    # The recorder of the history --------------------------------------------------------------------------------

    def put(self, index: int, step: Step, delta: Delta) -> None:
        with self._state:
            for later in [i for i in self._pending if i >= index]:
                del self._pending[later]
            self._cut = index if self._cut is None else min(self._cut, index)
            self._pending[index] = (step, delta)
        self._begin()

    def amend(self, index: int, step: Step) -> None:
        with self._state:
            delta = self._pending[index][1] if index in self._pending else None
            if index:
                self._pending[index] = (step, delta)
        self._begin()

    def move(self, index: int, clean: int) -> None:
        with self._state:
            self._marks |= {"index": index, "clean": clean}
        self._begin()

    def saved(self, graph: NavGraph) -> None:
        with self._state:
            self._marks["saved"] = graph
        self._begin()

    # Writing ----------------------------------------------------------------------------------------------------

    def flush(self) -> None:
        """All steps are on disk when this returns. Raises InputError when the disk refuses; they are kept then."""
        with self._writing:
            with self._state:
                pending, cut, marks, base = self._pending, self._cut, self._marks, self._base
                self._pending, self._cut, self._marks = {}, None, {}
            # Nothing is made for somebody who only looked or clicked.
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
        """Writes what is left and gives the lock back. Beside a foreign file that was saved, nothing stays. Raises
        InputError when the disk refuses; what was edited since is lost then."""
        if self._closed:
            return
        self._closed = True
        self._wake.set()
        if self._writer is not None:
            self._writer.join()
        try:
            if self.refusal is None:
                self.flush()
                if not self._done_with:
                    self._file.trim(KEPT_STEPS, KEPT_BYTES)
        finally:
            self._file.close()
            if self._lock is not None:
                if self._done_with:
                    self._file.remove()
                self._lock_path.unlink(missing_ok=True)
                self._lock.release()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _done_with(self) -> bool:
        """Whether it goes when it is closed."""
        return self._plain and (self._history is None or self._history.clean)

    @property
    def _lock_path(self) -> Path:
        return self.path.with_name(f"{self.path.name}.lock")

    def _keep(self, pending: dict[int, tuple[Step, Delta | None]], cut: int | None, marks: dict[str, Any]) -> None:
        """Puts back what was not written, beneath what came since."""
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
        """Writes until nothing came for a while; then the thread ends."""
        while not self._wake.wait(_PERIOD):
            try:
                self.flush()
            except InputError:
                continue  # `trouble` says it to whoever shows it; the next round tries again
            with self._state:
                if not self._pending and not self._marks or not self._file.exists:
                    self._writer = None
                    return

    def _trim(self) -> None:
        try:
            self._file.trim(KEPT_STEPS, KEPT_BYTES)
        except InputError as error:
            self.trouble = str(error)  # it is as long as before; a full disk is said with the next step as well

    def _read(self) -> Written | None:
        try:
            if self.refusal is None:
                self._trim()
            written = self._file.read()
            if written is not None:
                check_steps(written.base, (delta for _, delta in written.steps))
            return written
        except Newer:
            raise
        except (
            *(InputError, sqlite3.Error, ValueError, KeyError, TypeError, IndexError, EOFError),
            *(AttributeError, RecursionError, OverflowError, struct.error, zlib.error),
        ) as error:
            if self.refusal is not None:
                return None
            aside = self._file.set_aside()
            self.notice = f"The history of edits is damaged ({error}); it was set aside as {aside.name}."
            return None
