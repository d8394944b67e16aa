"""Choose the files of PlayCanvas's streamed SOG that are read together. Its lod-meta.json names SOGs in folders. A tree
of boxes says which of them have the Gaussians of each level of detail. Level 0 is the finest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TypeGuard

from nvsim.errors import InputError, value_text
from nvsim.files.opening import read_json
from nvsim.splats.formats.sog_files import META

INDEX = "lod-meta.json"
_MOST = 5_000_000  # Gaussians that are read; the finest level with at most that many is chosen
_WHAT, _THEN = "the index of a streamed SOG", "export it again"
_LEVELS = tuple(map(str, range(16)))


@dataclass(frozen=True)
class StreamedLevel:
    """A level of detail.

    number  0 is the finest
    levels  number of levels of the scene
    count   Gaussians of the level
    finest  Gaussians of level 0
    files   paths of its SOGs
    """

    number: int
    levels: int
    count: int
    finest: int
    files: tuple[Path, ...]


def level_to_read(index: Path) -> StreamedLevel:
    """The finest level with at most 5 million Gaussians, or the coarsest level if each has more.

    Raises InputError if lod-meta.json cannot be read, has no level, or names a file outside its folder."""
    meta = read_json(index, _WHAT, _THEN)
    names = meta.get("filenames") if isinstance(meta, Mapping) else None
    if not isinstance(names, list) or not names:
        raise InputError(f"{index} has no list of file names and is not {_WHAT}; {_THEN}.")
    counts: dict[int, int] = {}
    files: dict[int, set[int]] = {}
    boxes = [meta.get("tree")]
    while boxes:
        box = boxes.pop()
        children, parts = (box.get("children", []), box.get("lods", {})) if isinstance(box, Mapping) else (None, None)
        if not isinstance(children, list) or not isinstance(parts, Mapping):
            raise InputError(f"{index} has no valid tree of boxes; {_THEN}.")
        boxes += children
        for level, part in parts.items():
            file, count = (part.get("file"), part.get("count")) if isinstance(part, Mapping) else (None, None)
            if level not in _LEVELS or not _is_below(file, len(names)) or not _is_below(count, 1 << 31):
                raise InputError(f"{index} has {value_text(part)} as level {value_text(level)} of a box; {_THEN}.")
            counts[int(level)] = counts.get(int(level), 0) + count
            files.setdefault(int(level), set()).add(file)
    if not counts:
        raise InputError(f"{index} has no level of detail; {_THEN}.")
    number = min((n for n, count in counts.items() if count <= _MOST), default=max(counts))
    paths = tuple(_path(index, names[i]) for i in sorted(files[number]))
    return StreamedLevel(number, len(counts), counts[number], counts[min(counts)], paths)


def _is_below(value: object, limit: int) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < limit


def _path(index: Path, name: object) -> Path:
    path = PurePosixPath(name if isinstance(name, str) else "")
    if (
        path.is_absolute()
        or ".." in path.parts
        or "\\" in path.name
        or not (path.name == META or path.suffix == ".sog")
    ):
        raise InputError(f"{index} names {value_text(name)}, which is not a SOG in its folder; {_THEN}.")
    return index.parent / path
