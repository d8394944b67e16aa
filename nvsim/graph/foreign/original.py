"""The original of a connectivity file, kept beside the one that editing writes: NAME.json~.

Only what we did not write ourselves is an original, so the notes beside the file say what we wrote last: a later save
of ours leaves the original alone, and what another program wrote meanwhile is kept as well. A file of that name that
is not ours is never touched; NAME.json.~1~ and so on are used then.
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
    """name     of the file that is kept, in the folder of the one that is edited
    written  SHA-256 of what we wrote last in its place
    """

    name: str
    written: str


def keep(path: Path, known: Original | None, digest: str) -> Original | None:
    """Copies the file at `path` before text of SHA-256 `digest` takes its place, unless it is ours or nothing changes.
    Returns what the notes should say. Raises OSError."""
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
    """What was saved, where the file is as it was, and into how many parts the graph falls."""
    words = f"Saved {path.name}."
    if original is not None:
        words += f" The file as it was is {original.name}, beside it."
    return f"{words} {islands(graph)}".rstrip()


def islands(graph: NavGraph) -> str:
    """A sentence where not every viewpoint can be reached from every other; "" otherwise."""
    groups = components(graph)
    if len(groups) < 2:
        return ""
    sizes = ", ".join(str(len(group)) for group in groups[:4]) + (", …" if len(groups) > 4 else "")
    return f"The graph has {len(groups)} islands that no edge joins ({sizes} viewpoints)."
