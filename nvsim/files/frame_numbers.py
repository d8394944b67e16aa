"""Files that a stage numbers by the frames of the capture, with the names of these frames beside them. A capture that
is imported later can have fewer frames, so that the same frame has another number."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.atomic import write_text
from nvsim.files.opening import read_json

NAME = "frames.json"


def write_frame_names(folder: Path, names: Sequence[str]) -> None:
    """Writes the `names` of the frames whose numbers the files in `folder` have. Raises InputError if the file cannot
    be written."""
    write_text(folder / NAME, json.dumps(list(names)))


def number_in(folder: Path, name: str, index: int) -> int:
    """The number of the files in `folder` of the frame `name`, which is frame `index` of the present capture; -1 if the
    folder has none. Folders of earlier versions have no names: the number is `index`."""
    path = folder / NAME
    try:
        found = path.stat()
    except OSError:
        return index
    numbers = _numbers(path, found.st_mtime_ns, found.st_size)
    return index if numbers is None else numbers.get(name, -1)


@lru_cache(8)
def _numbers(path: Path, *_: int) -> dict[str, int] | None:
    try:
        names = read_json(path, "the names of the frames", "run the stage again")
    except InputError:
        return None
    return {name: k for k, name in enumerate(names) if isinstance(name, str)} if isinstance(names, list) else None
