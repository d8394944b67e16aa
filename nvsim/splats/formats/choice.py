"""Which format a file has, told by its content, and which one to write."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.regular import opened
from nvsim.splats.formats.cleaning import usable
from nvsim.splats.ply import read_ply, write_ply
from nvsim.splats.types import Gaussians

Format = Literal["ply", "compressed-ply", "spz"]
SUFFIXES: dict[Format, str] = {"ply": ".ply", "compressed-ply": ".compressed.ply", "spz": ".spz"}
READABLE = (".ply", ".spz", ".splat", ".sog", "meta.json")
"""What the names of files that `read_splats` understands end in; meta.json is of an unpacked SOG."""


_META, _LEVELS = "meta.json", "lod-meta.json"
Kind = Literal["ply", "compressed-ply", "spz", "sog", "splat"]


def named_as_splats(path: Path) -> bool:
    """Whether a file's name is one of a splat file; of JSON files, those of a SOG only."""
    if path.suffix.lower() == ".json":
        return path.name in (_META, _LEVELS)
    return path.name.lower().endswith(READABLE)


def recognise(path: Path) -> Kind:
    """The format of a file by its first bytes; only .splat, which has no header, is told by its name.

    Raises InputError when it cannot be read or is of no kind that may hold splats.
    """
    if path.name == _LEVELS:
        raise InputError(
            f"{path} is the index of a streamed SOG, which SuperSplat splits into levels of detail and which cannot be"
            " opened as a whole; open the meta.json of one of its folders, or export the scene as one .sog or .ply."
        )
    with opened(path) as file, reading(path, "a splat file"):
        head = file.read(4096)
        is_zip = path.name != _META and zipfile.is_zipfile(file)
    if head.startswith(b"ply"):
        return "compressed-ply" if b"packed_position" in head else "ply"
    if head.startswith((b"\x1f\x8b", b"NGSP")):
        return "spz"
    if path.name == _META or is_zip:
        return "sog"
    if path.suffix.lower() == ".splat":
        if head and _is_text(head):
            raise InputError(f"{path} is text, not a .splat file; download or export it again.")
        return "splat"
    raise InputError(
        f"{path} is no splat file that can be read; choose a .ply, .spz, .splat or .sog file, or the meta.json of an"
        " unpacked SOG."
    )


def _is_text(head: bytes) -> bool:
    """Whether the beginning of a file is text in UTF-8 without control characters; its last character may be cut."""
    for cut in range(4):
        try:
            text = head[: len(head) - cut].decode("utf-8")
        except UnicodeDecodeError:
            continue
        return all(c.isprintable() or c in "\t\n\r\f" for c in text)
    return False


@dataclass(frozen=True, eq=False)
class Splats:
    """A splat file as it was read.

    gaussians    in the frame of the file
    antialiased  whether they are to be drawn antialiased; None where the file does not say
    notes        sentences for the user, such as how many Gaussians are left out
    """

    gaussians: Gaussians
    antialiased: bool | None
    notes: tuple[str, ...] = ()


def read_splats(path: Path) -> Splats:
    """The Gaussians of a PLY (INRIA), compressed PLY (SuperSplat), SPZ, SOG or .splat file. Gaussians that cannot be
    drawn are left out, as `usable` says.

    Raises InputError naming the file and what is wrong with it.
    """
    gaussians, antialiased = _read(path)
    gaussians, notes = usable(path, gaussians)
    return Splats(gaussians, antialiased, notes)


def _read(path: Path) -> tuple[Gaussians, bool | None]:
    kind = recognise(path)
    if kind == "ply":
        return read_ply(path)
    if kind == "compressed-ply":
        from nvsim.splats.formats.compressed_ply import read_compressed_ply

        return read_compressed_ply(path), None
    if kind == "spz":
        from nvsim.splats.formats.spz import read_spz

        return read_spz(path)
    if kind == "sog":
        from nvsim.splats.formats.sog import read_sog

        return read_sog(path), None
    from nvsim.splats.formats.splat import read_splat

    return read_splat(path), None


def write_splats(path: Path, gaussians: Gaussians, antialiased: bool, form: Format) -> None:
    """Writes a splat file in the format that is asked for, under any name, whole or not at all. Compressed PLY has no
    place for `antialiased`. Raises InputError when the disk refuses, or when a format cannot hold the Gaussians."""
    if form == "ply":
        write_ply(path, gaussians, antialiased)
    elif form == "compressed-ply":
        from nvsim.splats.formats.compressed_ply import write_compressed_ply

        write_compressed_ply(path, gaussians)
    else:
        from nvsim.splats.formats.spz import write_spz

        write_spz(path, gaussians, antialiased)
