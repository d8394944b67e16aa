"""What is fuzzed: a reader, and the whole files that its damaged ones are made from."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

Files = dict[str, bytes]


class Place(bytes):
    """What stands where a file should be; its bytes name the kind: absent, folder, a link to itself, a pipe."""

    KINDS = (b"absent", b"folder", b"loop", b"pipe")


@dataclass(frozen=True)
class Seed:
    """files    relative path -> content: all that lies in the folder when the reader comes
    target   the one that is damaged
    opened   what the reader is given, "" for the folder
    form     how the target is built, so that damage goes below its surface: a key of `forms.FORMS`
    seal     what has to be true of the set after the damage for it to be read at all, such as a checksum
    readable whether the reader takes it as it is
    """

    files: Mapping[str, bytes] = field(repr=False)
    target: str
    opened: str
    form: str = "binary"
    seal: Callable[[Files], Files] | None = None
    readable: bool = True


@dataclass(frozen=True)
class Reader:
    """read        raises one of `refusals` for a file that it will not take
    seeds       made once, before anything is damaged
    disposable  whether reading writes into the folder, which is then laid out anew for every input
    share       how often it is drawn, beside the 1 of others
    """

    name: str
    seeds: Callable[[], list[Seed]]
    read: Callable[[Path], object]
    disposable: bool = False
    share: int = 1
    refusals: tuple[type[Exception], ...] = ()


def files_in(folder: Path) -> Files:
    """Every file below `folder` by its relative path."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def content(path: Path) -> bytes:
    """For a reader that is not given a file but what a caller took from one; nothing where there is none."""
    return path.read_bytes() if path.is_file() else b""


def lay(files: Files, folder: Path) -> None:
    """Writes the set of files below `folder`, over what is there."""
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
    """A seed for every target of `forms` (relative path -> form), over the same set of files."""
    return [Seed(files, target, opened, form, seal) for target, form in forms.items()]
