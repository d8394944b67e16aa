"""Definitions for fuzzing: a reader, and the undamaged files from which its damaged inputs are made."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

Files = dict[str, bytes]


class Place(bytes):
    """Replaces a file by something else. The bytes name the kind: absent, folder, a link to itself, a pipe."""

    KINDS = (b"absent", b"folder", b"loop", b"pipe")


@dataclass(frozen=True)
class Seed:
    """files    relative path -> content, of all files in the folder
    target   the file that is damaged
    opened   the path that the reader gets, "" for the folder
    form     structure of the target, so that damage reaches its content: a key of `forms.FORMS`
    seal     function that makes the files consistent after the damage, such as a checksum; None if not needed
    readable whether the reader accepts the undamaged file
    """

    files: Mapping[str, bytes] = field(repr=False)
    target: str
    opened: str
    form: str = "binary"
    seal: Callable[[Files], Files] | None = None
    readable: bool = True


@dataclass(frozen=True)
class Reader:
    """read        raises one of `refusals` for a file that it refuses
    seeds       creates the seeds once, before any damage
    disposable  whether reading writes to the folder, which is then created again for every input
    share       relative frequency; other readers have 1
    """

    name: str
    seeds: Callable[[], list[Seed]]
    read: Callable[[Path], object]
    disposable: bool = False
    share: int = 1
    refusals: tuple[type[Exception], ...] = ()


def files_in(folder: Path) -> Files:
    """The content of every file below `folder`, by relative path."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def content(path: Path) -> bytes:
    """The content of a file, for a reader that takes bytes; empty if the file is missing."""
    return path.read_bytes() if path.is_file() else b""


def lay(files: Files, folder: Path) -> None:
    """Writes files below `folder` and replaces existing ones."""
    for name, content in files.items():
        path = folder / name
        if path.is_symlink() or path.is_fifo():
            path.unlink()
        elif path.is_dir():
            path.rmdir()
        if not isinstance(content, Place):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            continue
        path.unlink(missing_ok=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        if content == b"folder":
            path.mkdir()
        elif content == b"loop":
            path.symlink_to(path.name)
        elif content == b"pipe":
            os.mkfifo(path)


def each(
    files: Files, opened: str, forms: Mapping[str, str], seal: Callable[[Files], Files] | None = None
) -> list[Seed]:
    """A seed for every target in `forms` (relative path -> form), all with the given files."""
    return [Seed(files, target, opened, form, seal) for target, form in forms.items()]
