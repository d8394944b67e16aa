"""Find COLMAP models in a folder, in the layouts of COLMAP, nerfstudio, 3D Gaussian Splatting, and instant-ngp.

Model folders have technical names such as `sparse`, `dense` or `0`, so the search enters no other folder.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from nvsim.capture.raw import file_size, natural_order
from nvsim.errors import InputError, value_text

EXTENSIONS = (".bin", ".txt")
LISTS = ("cameras", "images", "points3D")
RIG_LISTS = ("rigs", "frames")
_PREFERRED = ("", "sparse", "colmap/sparse", "distorted/sparse")
_TECHNICAL = re.compile(
    r"\d+|.*sparse.*|.*colmap.*|.*reconstruction.*|.*sfm.*|dense|models?|(un)?distorted|aligned|geo\w*|text|txt|bin(ary)?",
    re.IGNORECASE,
)
_DEEPEST = 4  # levels below the searched folder: colmap/dense/0/sparse
_MOST = 200  # model folders


@dataclass(frozen=True)
class ModelFolder:
    """A folder with cameras and images as .bin or .txt.

    name  path relative to the searched folder, with forward slashes; "." for that folder itself
    """

    folder: Path
    extension: str
    name: str


def model_extension(folder: Path) -> str | None:
    """The extension, .bin or .txt, for which `folder` holds both cameras and images; None if there is none. If both
    extensions are complete, it is .bin."""
    for extension in EXTENSIONS:
        if all(file_size(folder / f"{stem}{extension}") is not None for stem in ("cameras", "images")):
            return extension
    return None


def models_in(root: Path) -> list[ModelFolder]:
    """All models in and below `root`: preferred layouts first, numbered models in numeric order."""
    found = []
    for folder in technical_folders(root):
        extension = model_extension(folder)
        if extension is not None:
            found.append(ModelFolder(folder, extension, folder.relative_to(root).as_posix()))
    return sorted(found, key=lambda model: _rank(model.name))


def technical_folders(root: Path) -> list[Path]:
    """`root` and the folders below it that may hold a model or a part of a model."""
    found, level = [root], [root]
    for _ in range(_DEEPEST):
        level = [child for folder in level for child in child_folders(folder) if is_technical(child)]
        found += level[: _MOST - len(found)]
    return found


def is_technical(folder: Path) -> bool:
    """Whether programs use the name of this folder for models or parts of models."""
    return _TECHNICAL.fullmatch(folder.name) is not None


def child_folders(folder: Path) -> list[Path]:
    """The folders in `folder` that are not hidden, sorted by name; empty if the folder cannot be read."""
    try:
        with os.scandir(folder) as entries:
            names = [entry.name for entry in entries if not entry.name.startswith(".") and entry.is_dir()]
    except OSError:
        return []
    return [folder / name for name in sorted(names, key=natural_order)]


def is_usual_path(model: ModelFolder) -> bool:
    """Whether the model is at a path where COLMAP, nerfstudio, and 3D Gaussian Splatting write models."""
    return _rank(model.name)[0] == 0


def _rank(name: str) -> tuple[int, int, int, list[tuple[int, int, str]]]:
    """Sort key: preferred layouts first, then their numbered models, then all others by depth and name."""
    parent, _, last = "" if name == "." else name, "", ""
    if parent not in _PREFERRED:
        parent, _, last = parent.rpartition("/")
    numbered = last.isdigit()
    if parent in _PREFERRED and (not last or numbered):
        return 0, _PREFERRED.index(parent), int(numbered), natural_order(last)
    return 1, name.count("/"), 0, natural_order(name)


def numbered_with(model: ModelFolder, models: list[ModelFolder]) -> list[ModelFolder]:
    """`model` and the models that COLMAP's mapper wrote with it: the numbered folders with the same parent."""
    if not model.folder.name.isdigit():
        return [model]
    return [m for m in models if m.folder.parent == model.folder.parent and m.folder.name.isdigit()]


def model_named(root: Path, name: str) -> Path:
    """The folder of the model that `name` selects: its path below `root`, or the name of its folder, such as 1.

    Raises InputError that lists the models if no model has this name."""
    models = models_in(root if root.is_dir() else root.parent)
    wanted = name.strip().strip("/").replace("\\", "/")
    for model in models:
        if model.name == wanted:
            return model.folder
    for model in models:
        if model.folder.name == wanted:
            return model.folder
    if not models:
        raise InputError(
            f"{value_text(root)} holds no COLMAP model, so --model {value_text(name)} selects nothing; omit --model."
        )
    listed = ", ".join(model.name for model in models[:20])
    raise InputError(
        f"{value_text(root)} has no model {value_text(name)!r}; give --model one of {listed}, or only its last part."
    )


def missing_from_model(root: Path) -> str:
    """A sentence about an incomplete COLMAP model in or below `root`, or about a database without a model; "" if there
    is neither."""
    folders = technical_folders(root)
    for folder in folders:
        names = [f"{stem}{x}" for stem in (*LISTS, *RIG_LISTS) for x in EXTENSIONS]
        present = [name for name in names if file_size(folder / name) is not None]
        stems = {name.split(".")[0] for name in present}
        if not stems or (folder == root and len(stems) < 2 and "points3D" not in stems):
            continue  # other programs also write a cameras.txt
        listed = " and ".join([", ".join(present[:-1]), present[-1]] if len(present) > 1 else present)
        missing = [stem for stem in ("cameras", "images") if stem not in stems]
        if missing:
            lacking = " and no ".join(f"{stem}.bin or {stem}.txt" for stem in missing)
            return f"{value_text(folder)} has {listed}, but no {lacking}; export or copy the whole COLMAP model."
        return f"{value_text(folder)} has {listed}, but a COLMAP model is all .bin or all .txt; export it again."
    for folder in folders:
        for database in sorted(folder.glob("*.db")):
            if _is_database(database):
                return (
                    f"{value_text(database)} is a COLMAP database without a model; run COLMAP's mapper (colmap "
                    "mapper) and name the folder of its output."
                )
    return ""


def _is_database(path: Path) -> bool:
    """Whether `path` is an SQLite file, like COLMAP's databases."""
    if file_size(path) is None:
        return False
    try:
        with open(path, "rb") as file:
            return file.read(16) == b"SQLite format 3\0"
    except OSError:
        return False
