"""Lists a folder with the kind of each entry in a thread, for the dialog that opens files."""

from __future__ import annotations

import contextlib
import itertools
import os
import threading
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from nvsim.errors import InputError
from nvsim.files.reading import as_reading_error
from nvsim.project.path_kind import PathKind, path_kind

OPENABLE: tuple[PathKind, ...] = ("project", "capture", "video", "graph", "graph folder", "splats")
_MOST = 5_000  # maximum number of listed entries of a folder


@dataclass(frozen=True)
class Entry:
    """A folder, or a file that can be opened. A folder may itself be a project, a capture, or a folder of graphs."""

    path: Path
    kind: PathKind
    is_folder: bool

    @property
    def openable(self) -> bool:
        return self.kind in OPENABLE


@dataclass(frozen=True)
class Listing:
    """The contents of a folder.

    folder   the listed folder
    kind     the kind of the folder itself
    entries  folders and files that can be opened, folders first, sorted by name
    others   number of files that cannot be opened
    cut      whether the folder has more entries than were listed
    """

    folder: Path
    kind: PathKind
    entries: tuple[Entry, ...]
    others: int
    cut: bool


class FolderLook:
    """Lists `folder` when `result` is called. Call it in a thread, because a disk may be slow."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._killed = threading.Event()

    def kill(self) -> None:
        """Cancels the listing. Can be called from any thread."""
        self._killed.set()

    def result(self) -> Listing | None:
        """The listing; None after `kill`. Raises InputError if the folder cannot be read."""
        try:
            with os.scandir(self._folder) as found:
                seen = [(e.name, e.is_dir()) for e in itertools.islice(found, _MOST + 1) if not e.name.startswith(".")]
        except (OSError, ValueError) as error:
            raise (
                as_reading_error(self._folder, error)
                if isinstance(error, OSError)
                else InputError(f"{str(self._folder)!r} is not a valid folder name; check the path.")
            ) from error
        entries, others = [], 0
        for name, is_folder in sorted(seen[:_MOST], key=lambda e: (not e[1], e[0].casefold())):
            if self._killed.is_set():
                return None
            path = self._folder / name
            entry = Entry(path, path_kind(path), is_folder)
            if is_folder or entry.openable:
                entries.append(entry)
            else:
                others += 1
        return Listing(self._folder, path_kind(self._folder), tuple(entries), others, len(seen) > _MOST)


class Listings(QObject):
    """Lists folders in a thread. Only the newest folder is awaited.

    ended(listing, trouble): the Listing, None if the folder cannot be read; and the error sentence, "" if there is none
    """

    ended = Signal(object, str)
    _heard = Signal(object, object, str)  # from the thread: the FolderLook, its result

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._look: FolderLook | None = None
        self._thread: threading.Thread | None = None
        self._heard.connect(self._on_heard)

    @property
    def busy(self) -> bool:
        return self._look is not None

    def start(self, folder: Path) -> None:
        """Lists `folder`, and cancels the previous listing."""
        self.stop()
        look = self._look = FolderLook(folder)

        def work() -> None:
            listing, trouble = None, ""
            try:
                listing = look.result()
            except InputError as error:
                trouble = str(error)
            with contextlib.suppress(RuntimeError):  # the dialog may be deleted meanwhile
                self._heard.emit(look, listing, trouble)

        self._thread = threading.Thread(target=work, name="folder", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Cancels the listing without emitting `ended`, and returns after its thread has ended."""
        look, self._look = self._look, None
        if look is not None:
            look.kill()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _on_heard(self, look: FolderLook, listing: Listing | None, trouble: str) -> None:
        if look is self._look:
            self.stop()
            self.ended.emit(listing, trouble)
