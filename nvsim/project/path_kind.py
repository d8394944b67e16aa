"""Recognizes the kind of any path, for the command line, dialogs, and dropped files."""

from __future__ import annotations

import itertools
import os
import stat
from pathlib import Path
from typing import Literal

from nvsim.errors import InputError
from nvsim.files.opening import is_regular, opened
from nvsim.files.placeholders import is_metadata_name
from nvsim.files.reading import reading
from nvsim.footage.sources import VIDEO_SUFFIXES
from nvsim.occupancy.read import OCTOMAP, ROS
from nvsim.project.layout import Layout

PathKind = Literal[
    "project",
    "graph",
    "graph folder",
    "splats",
    "capture",
    "video",
    "occupancy map",
    "nothing",
    "unreadable",
    "unknown",
]
GRAPHS: tuple[PathKind, ...] = ("graph", "graph folder")
_SENTENCES: dict[PathKind, str] = {
    "project": "is a project; open it, or give it to a command with --project.",
    "graph": "is an R2R connectivity file; open it, or give it to a command that takes a graph.",
    "graph folder": "is a folder of R2R connectivity files; open it, or give it to a command that takes a graph.",
    "splats": "is a splat file; open it, or make a project of it with `nvsim run FILE --project PATH`.",
    "capture": "is a capture; make a project of it with `nvsim import CAPTURE --project PATH`.",
    "video": (
        "is a video or a folder of videos; make a project of it with "
        "`nvsim run VIDEO --project PATH --camera-height METERS`."
    ),
    "occupancy map": "is an occupancy map; give it to `nvsim evaluate graph`.",
    "nothing": "does not exist; check the path.",
    "unreadable": "cannot be read: it is a pipe or a device, or permission is denied; check the path.",
    "unknown": "is not a project, a graph, a splat file, a capture, a video or an occupancy map; check the path.",
}
_MOST_ENTRIES = 100_000  # limit for the entries of a folder
_HEAD = 4096  # bytes of a file


def path_kind(path: Path) -> PathKind:
    """The kind of a path by its names and first bytes. Opens only regular files, so that it never blocks. A link counts
    as its target. Never raises."""
    path = Path(path)
    try:
        path = path.expanduser()
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return "nothing"
    except (OSError, ValueError, RuntimeError):  # no permission, a loop of links, a NUL, an unknown home folder
        return "unreadable"
    if stat.S_ISDIR(mode):
        return _folder_kind(path)
    return _file_kind(path) if stat.S_ISREG(mode) else "unreadable"


def sentence_about(path: Path, kind: PathKind) -> str:
    """A sentence with the kind of the path and the action for it."""
    return f"{path} {_SENTENCES[kind]}"


def check_openable(path: Path) -> None:
    """Raises InputError if the window cannot open `path`. It can open projects of this or older versions, R2R
    connectivity files, folders of them, and splat files."""
    kind = path_kind(path)
    if kind in ("capture", "video", "occupancy map"):
        raise InputError(sentence_about(path, kind))
    with reading(path, "a project, a connectivity file or a splat file", "choose one that is"):
        if kind in GRAPHS:
            from nvsim.graph.foreign import connectivity_files

            connectivity_files(path)
        elif kind in ("splats", "unknown", "unreadable") and not path.is_dir():
            from nvsim.splats.formats.choice import recognize

            recognize(path)
        else:
            from nvsim.project.project import Project

            Project.open(path).close()


def _folder_kind(folder: Path) -> PathKind:
    from nvsim.graph.connectivity import SUFFIX

    if is_regular(Layout(folder).database):
        return "project"
    try:
        with os.scandir(folder) as entries:
            names = {e.name for e in itertools.islice(entries, _MOST_ENTRIES) if not is_metadata_name(e.name)}
    except OSError:
        return "unreadable"
    if is_regular(folder / "scans.txt") or any(name.endswith(SUFFIX) for name in names):
        return "graph folder"
    from nvsim.capture.formats import is_capture

    if is_capture(folder):
        return "capture"
    return "video" if any(Path(name).suffix.lower() in VIDEO_SUFFIXES for name in names) else "unknown"


def _file_kind(path: Path) -> PathKind:
    from nvsim.capture.formats import is_capture
    from nvsim.graph.connectivity import SUFFIX
    from nvsim.splats.formats.choice import named_as_splats, recognize

    if named_as_splats(path):
        return "splats"
    if path.name.endswith(SUFFIX):
        return "graph"
    if path.suffix.lower() in (*ROS, *OCTOMAP):
        return "occupancy map"
    if path.suffix.lower() in VIDEO_SUFFIXES:
        return "video"
    try:
        if path.suffix.lower() == ".json":
            with opened(path) as file:
                return _json_kind(file.read(_HEAD) or b"")
        if is_capture(path):
            return "capture"
        recognize(path)
    except InputError:
        return "unknown" if os.access(path, os.R_OK) else "unreadable"
    except (OSError, ValueError):
        return "unreadable"
    return "splats"


def _json_kind(head: bytes) -> PathKind:
    """A connectivity file is a JSON list, a transforms.json an object."""
    begin = head.removeprefix(b"\xef\xbb\xbf").lstrip()[:1]
    return "graph" if begin == b"[" else "capture" if begin == b"{" else "unknown"
