"""Lists a folder with the kind of each entry, for the dialog that opens files. Does not use Qt."""

from __future__ import annotations

import itertools
import os
import threading
from dataclasses import dataclass
from pathlib import Path

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


def list_folder(folder: Path, stopped: threading.Event) -> Listing | None:
    """Lists `folder`. Call it in a thread, because a disk may be slow. Returns None if `stopped` is set meanwhile.
    Raises InputError if the folder cannot be read."""
    try:
        with os.scandir(folder) as found:
            seen = [(e.name, e.is_dir()) for e in itertools.islice(found, _MOST + 1) if not e.name.startswith(".")]
    except OSError as error:
        raise as_reading_error(folder, error) from error
    except ValueError as error:
        raise InputError(f"{str(folder)!r} is not a valid folder name; check the path.") from error
    entries, others = [], 0
    for name, is_folder in sorted(seen[:_MOST], key=lambda e: (not e[1], e[0].casefold())):
        if stopped.is_set():
            return None
        path = folder / name
        entry = Entry(path, path_kind(path), is_folder)
        if is_folder or entry.openable:
            entries.append(entry)
        else:
            others += 1
    return Listing(folder, path_kind(folder), tuple(entries), others, len(seen) > _MOST)
