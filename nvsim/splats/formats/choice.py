"""Detect the format of a splat file by its content, read it, and write a requested format."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.errors import InputError
from nvsim.files.opening import opened
from nvsim.files.reading import reading
from nvsim.splats.formats.cleaning import renderable_gaussians
from nvsim.splats.formats.sog import INDEX, level_to_read
from nvsim.splats.formats.sog_files import META
from nvsim.splats.formats.splat_list import SUFFIX, is_list, join_splats, listed_splats
from nvsim.splats.ply import read_ply, write_ply
from nvsim.splats.turning import Up, up_axis
from nvsim.splats.types import Gaussians

Format = Literal["ply", "compressed-ply", "spz"]
SUFFIXES: dict[Format, str] = {"ply": ".ply", "compressed-ply": ".compressed.ply", "spz": ".spz"}
READABLE = (".ply", ".spz", ".splat", ".ksplat", ".sog", "meta.json", SUFFIX)
"""Endings of the file names that `read_splats` can read. meta.json belongs to an unpacked SOG."""


Kind = Literal["ply", "compressed-ply", "spz", "sog", "splat", "ksplat"]


def named_as_splats(path: Path) -> bool:
    """Whether the file name is one of a splat file. Of JSON files, only those of a SOG count."""
    if path.suffix.lower() == ".json":
        return path.name in (META, INDEX)
    return path.name.lower().endswith(READABLE)


def recognize(path: Path) -> Kind:
    """The format of a file, detected by its first bytes. Only .splat and .ksplat are detected by their names. The
    format of a list is that of its first file.

    Raises InputError if the file cannot be read or is not a splat file.
    """
    if is_list(path):
        kinds = [recognize(one.path) for one in listed_splats(path)]
        return kinds[0]
    with opened(path) as file, reading(path, "a splat file"):
        head = file.read(4096)
        is_zip = path.name != META and zipfile.is_zipfile(file)
    if head.startswith(b"ply"):
        return "compressed-ply" if b"packed_position" in head else "ply"
    if head.startswith((b"\x1f\x8b", b"NGSP")):
        return "spz"
    if path.name == META or is_zip:
        return "sog"
    if path.suffix.lower() == ".splat":
        if head and _is_text(head):
            raise InputError(f"{path} is text, not a .splat file; download or export it again.")
        return "splat"
    if path.suffix.lower() == ".ksplat":
        return "ksplat"
    raise InputError(
        f"{path} is not a splat file that NVSim can read; choose a .ply, .spz, .splat, .ksplat or .sog file, or the"
        " meta.json of an unpacked SOG."
    )


def _is_text(head: bytes) -> bool:
    """Whether the beginning of a file is UTF-8 text without control characters; its last character may be cut."""
    for cut in range(4):
        try:
            text = head[: len(head) - cut].decode("utf-8")
        except UnicodeDecodeError:
            continue
        return all(c.isprintable() or c in "\t\n\r\f" for c in text)
    return False


@dataclass(frozen=True, eq=False)
class Splats:
    """The content of a splat file.

    gaussians    in the frame of the file
    antialiased  whether to render them with antialiasing; None if the file does not specify it
    notes        sentences for the user, such as the number of removed Gaussians
    """

    gaussians: Gaussians
    antialiased: bool | None
    notes: tuple[str, ...] = ()


def read_splats(path: Path) -> Splats:
    """Reads a PLY (INRIA), compressed PLY (SuperSplat), SPZ, SOG, .splat or .ksplat file, or a .splats list of such
    files. Gaussians that cannot be rendered are removed, see `renderable_gaussians`.

    Raises InputError naming the file and the defect.
    """
    if is_list(path):
        return _read_several(path)
    gaussians, antialiased = _read(path)
    gaussians, notes = renderable_gaussians(path, gaussians)
    return Splats(gaussians, antialiased, notes)


def _read_several(path: Path) -> Splats:
    listed = listed_splats(path)
    contents = [read_splats(one.path) for one in listed]
    antialiased = {one.antialiased for one in contents} - {None}
    if len(antialiased) > 1:
        raise InputError(
            f"{path} names files for rendering with antialiasing and others without; export all of them in one way."
        )
    notes = tuple(note for one in contents for note in one.notes)
    if path.name == INDEX:
        level = level_to_read(path)
        notes += (
            f"{path} has {level.levels} levels of detail with up to {level.finest:,} Gaussians; NVSim reads level "
            f"{level.number} with {level.count:,}.",
        )
    gaussians = join_splats(listed, [one.gaussians for one in contents])
    return Splats(gaussians, next(iter(antialiased), None), notes)


def files_of(path: Path) -> list[Path]:
    """The files whose content `read_splats` returns: `path`, and those that it names if it is a list. Raises InputError
    if the list cannot be read."""
    return [path, *(one.path for one in listed_splats(path))] if is_list(path) else [path]


def source_up_axis(path: Path) -> Up:
    """The usual up axis of a splat file, see `up_axis`; of a list, that of its first file. Raises InputError if the
    file cannot be read."""
    return up_axis(listed_splats(path)[0].path if is_list(path) else path)


def _read(path: Path) -> tuple[Gaussians, bool | None]:
    kind = recognize(path)
    if kind == "ply":
        return read_ply(path)
    if kind == "compressed-ply":
        from nvsim.splats.formats.gsply_formats import read_compressed_ply

        return read_compressed_ply(path), None
    if kind == "spz":
        from nvsim.splats.formats.gsply_formats import read_spz

        return read_spz(path)
    if kind == "sog":
        from nvsim.splats.formats.sog import read_sog

        return read_sog(path), None
    if kind == "ksplat":
        from nvsim.splats.formats.splat import read_ksplat

        return read_ksplat(path), None
    from nvsim.splats.formats.splat import read_splat

    return read_splat(path), None


def write_splats(path: Path, gaussians: Gaussians, antialiased: bool, form: Format) -> None:
    """Writes a splat file in the format `form` atomically. The format does not depend on the file name. Compressed PLY
    cannot store `antialiased`. Raises InputError if the disk refuses, or if the format cannot store the Gaussians."""
    if form == "ply":
        write_ply(path, gaussians, antialiased)
    elif form == "compressed-ply":
        from nvsim.splats.formats.gsply_formats import write_compressed_ply

        write_compressed_ply(path, gaussians)
    else:
        from nvsim.splats.formats.gsply_formats import write_spz

        write_spz(path, gaussians, antialiased)
