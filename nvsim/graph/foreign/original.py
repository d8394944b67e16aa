"""Keep the original of an edited connectivity file beside it: NAME.json~.

Only content that NVSim did not write is an original, so the notes record the digest of NVSim's last write. Another save
by NVSim leaves the original unchanged. Content that another program wrote is kept as well. Existing files are never
overwritten: if NAME.json~ exists, NAME.json.~1~ and so on are used.
"""

from __future__ import annotations

import hashlib
import itertools
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from nvsim.graph.components import components
from nvsim.graph.types import NavGraph


@dataclass(frozen=True)
class Original:
    """A kept original.

    name     its file name, in the folder of the edited file
    written  SHA-256 of NVSim's last write to the edited file
    """

    name: str
    written: str


def keep(path: Path, known: Original | None, digest: str) -> Original | None:
    """Copy the file at `path` before text of SHA-256 `digest` replaces it. Nothing is copied if NVSim wrote the file or
    if the content does not change. Returns the record for the notes. Raises OSError if copying fails."""
    if not path.is_file():
        return known
    held = hashlib.sha256(path.read_bytes()).hexdigest()
    if held == digest:
        return known
    if known is not None and known.written == held and (path.parent / known.name).is_file():
        return Original(known.name, digest)
    return Original(_copied(path).name, digest)


def _copied(path: Path) -> Path:
    names = itertools.chain([f"{path.name}~"], (f"{path.name}.~{number}~" for number in itertools.count(1)))
    for name in names:
        copy = path.with_name(name)
        try:
            descriptor = os.open(copy, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666)
        except FileExistsError:
            continue
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(path.read_bytes())
                file.flush()
                os.fsync(file.fileno())
            shutil.copystat(path, copy)
        except BaseException:
            copy.unlink(missing_ok=True)
            raise
        return copy
    raise AssertionError("there is always a next name")


def words_of_saving(path: Path, original: Path | None, graph: NavGraph) -> str:
    """Return a message: the saved file, the name of its original, and the number of components of the graph if there
    are several."""
    words = f"Saved {path.name}."
    if original is not None:
        words += f" The original is kept as {original.name}."
    return f"{words} {islands(graph)}".rstrip()


def islands(graph: NavGraph) -> str:
    """Return a sentence if some viewpoints cannot reach others; "" otherwise."""
    groups = components(graph)
    if len(groups) < 2:
        return ""
    sizes = ", ".join(str(len(group)) for group in groups[:4]) + (", …" if len(groups) > 4 else "")
    return f"The graph has {len(groups)} disconnected islands ({sizes} viewpoints)."
