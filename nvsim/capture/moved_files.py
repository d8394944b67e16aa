"""Find files of a capture that are not at their listed path, by name below a folder.

A copied capture still lists the paths of the computer that wrote it. Paths may be absolute or Windows paths, or differ
in case: `Images/` for `images/`, `.JPG` for `.jpg`. Files of one listed folder move together, so each folder is matched
as a whole. The best match contains the names, and the end of its path is most similar to the listed path. Case and
Unicode normalization are ignored. The extension of an image is ignored if the folder has only one image of that name.
"""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from nvsim.capture.findings import Findings
from nvsim.capture.raw import file_size
from nvsim.errors import value_text

IMAGE_EXTENSIONS = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp", ".ppm", ".pgm")
CLOUD_EXTENSIONS = (".ply", ".pcd")
_MOST_FILES = 300_000  # below a folder; a folder with more is not a capture, and its names are not unique
_DOWNSCALED = re.compile(r"images_(2|4|8|16)")  # downscaled copies of `images` by nerfstudio and mip-NeRF 360
_CONTENT = {
    **dict.fromkeys(("depth", "depths", "depthmap", "depthmaps"), "depth"),
    **dict.fromkeys(("mask", "masks"), "mask"),
    **dict.fromkeys(("normal", "normals"), "normal"),
    **dict.fromkeys(("semantic", "semantics", "segmentation", "segmentations", "label", "labels"), "semantic"),
    **dict.fromkeys(("confidence", "confidences"), "confidence"),
}


@dataclass(frozen=True)
class Relocation:
    """found      listed path -> the file that was found for it
    ambiguous  listed path -> the folders that match equally well, none of which was chosen
    """

    found: dict[Path, Path] = field(default_factory=dict)
    ambiguous: dict[Path, tuple[Path, ...]] = field(default_factory=dict)


def report_moved(kind: str, found: Mapping[Path, Path], source: Path, findings: Findings) -> None:
    """Add a note about the files of a `kind` ("image") that were `found` by name; none if `found` is empty."""
    if not found:
        return
    listed, place = next(iter(found.items()))
    count = f"{len(found)} {kind}s are" if len(found) > 1 else f"{'an' if kind[0] in 'aeiou' else 'a'} {kind} is"
    option = "; --images FOLDER names another folder" if kind == "image" else ""
    findings.note(
        f"{count} not where the capture says, and found by name",
        source.name,
        f"{value_text(listed)} is read from {value_text(place)}{option}",
    )


@dataclass(frozen=True)
class _Folder:
    parts: tuple[str, ...]  # of its path below the root, case-folded
    content: frozenset[str]
    files: dict[str, list[str]]  # normalized name -> the names


class FolderFiles:
    """The files below `root`, by name. The folder is searched on first use. Symbolic links are followed once; hidden
    folders and NVSim projects are skipped."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._folders: dict[Path, _Folder] | None = None

    def find(self, listed: Path) -> Path | None:
        """The file that `listed` names: itself, or the only file that matches by name; None otherwise."""
        if file_size(listed) is not None:
            return listed
        return self.relocate([listed]).found.get(listed)

    def relocate(self, listed: Iterable[Path], others: Iterable[Path] = ()) -> Relocation:
        """Find the files among `listed` that do not exist.

        If some files of a listed folder exist, the folder was not moved. Its missing files are then searched only in
        that folder, with another case or extension. A file is assigned to at most one listed path. It is not assigned
        if it already is a listed file or one of `others`."""
        paths = [path for path in dict.fromkeys(listed) if "\0" not in str(path)]  # file names cannot contain \0
        present = {path for path in paths if file_size(path) is not None}
        groups: dict[Path, list[Path]] = {}
        for path in paths:
            groups.setdefault(path.parent, []).append(path)
        found: dict[Path, Path] = {}
        ambiguous: dict[Path, tuple[Path, ...]] = {}
        for folder, members in groups.items():
            missing = [path for path in members if path not in present]
            if not missing:
                continue
            if len(missing) < len(members):
                best = [folder.resolve()] if folder.resolve() in self._list_folders else []
            else:
                best = self._best_folders(folder, missing)
            if len(best) > 1:
                ambiguous.update(dict.fromkeys(missing, tuple(best)))
            elif best:
                for path in missing:
                    names = _matching(self._list_folders[best[0]], path.name)
                    if len(names) == 1:
                        found[path] = best[0] / names[0]
        users: dict[Path, list[Path]] = {}
        for path, file in found.items():
            users.setdefault(file, []).append(path)
        taken = {path.resolve() for path in (*present, *others) if "\0" not in str(path)}
        for file, of in users.items():
            if len(of) > 1 or file in taken:
                for path in of:
                    del found[path]
        return Relocation(found, ambiguous)

    def _best_folders(self, listed: Path, missing: Sequence[Path]) -> list[Path]:
        """The folders that match best. A candidate has at least half as many of the names as any other folder.

        Candidates are ranked by the longest common end of the paths, then the number of names, then full-size images
        over downscaled ones."""
        folders = self._list_folders
        below = listed.relative_to(self.root) if listed.is_relative_to(self.root) else listed
        parts = tuple(part.casefold() for part in _parts(below))
        of_listed, of_end = _content(parts), _content(parts[-2:])
        fitting = {
            path: sum(len(_matching(folder, p.name)) == 1 for p in missing)
            for path, folder in folders.items()
            if of_end <= folder.content <= of_listed
        }
        most = max(fitting.values(), default=0)
        if most == 0:
            return []
        rank = {
            path: (_common_end(folders[path].parts, parts), count, -_reduction(path.name))
            for path, count in fitting.items()
            if 2 * count >= most
        }
        best = max(rank.values())
        return sorted(path for path, value in rank.items() if value == best)

    @property
    def _list_folders(self) -> dict[Path, _Folder]:
        if self._folders is None:
            self._folders = _list_folders_below(self.root)
        return self._folders


def _list_folders_below(root: Path) -> dict[Path, _Folder]:
    """Resolved path -> folder, for `root` and the folders below it that have files; empty if there are too many."""
    folders: dict[Path, _Folder] = {}
    waiting: list[tuple[Path, tuple[str, ...]]] = [(root, ())]
    seen: set[Path] = set()
    count = 0
    while waiting:
        place, parts = waiting.pop()
        files: dict[str, list[str]] = {}
        try:
            place = place.resolve()
            if place in seen:
                continue
            seen.add(place)
            with os.scandir(place) as entries:
                for entry in entries:
                    count += 1
                    if count > _MOST_FILES:
                        return {}
                    if entry.is_dir():
                        if not entry.name.startswith(".") and not entry.name.endswith(".nvsim"):
                            waiting.append((place / entry.name, (*parts, entry.name.casefold())))
                    elif entry.is_file():
                        files.setdefault(_key(entry.name), []).append(entry.name)
        except (OSError, RuntimeError):
            continue  # a folder that cannot be read offers no files
        if files:
            folders[place] = _Folder(parts, _content(parts), files)
    return folders


def _matching(folder: _Folder, name: str) -> list[str]:
    """The names in `folder` that `name` may mean: itself, or names that differ in case or in .jpeg for .jpg. If there
    are none, names with another image extension."""
    name = name.replace("\\", "/").rsplit("/", 1)[-1]
    names = folder.files.get(_key(name), [])
    if name in names:
        return [name]
    if not names and not name.lower().endswith(CLOUD_EXTENSIONS):
        end = next((e for e in IMAGE_EXTENSIONS if name.lower().endswith(e)), "")
        stem = name[: len(name) - len(end)]
        keys = dict.fromkeys(_key(stem + extension) for extension in IMAGE_EXTENSIONS)
        names = [found for key in keys for found in folder.files.get(key, [])]
    return names


def _key(name: str) -> str:
    name = unicodedata.normalize("NFC", name).casefold()  # macOS stores umlauts as two characters
    return name.removesuffix(".jpeg") + ".jpg" if name.endswith(".jpeg") else name


def _parts(path: Path) -> list[str]:
    return [p for p in str(path).replace("\\", "/").split("/") if p not in ("", ".", "..")]


def _content(parts: Sequence[str]) -> frozenset[str]:
    """The content types of a folder other than images, from the words in its path. Prevents a depth map from replacing
    an image."""
    words = [word for part in parts for word in re.split(r"[^a-z]+", part)]
    return frozenset(_CONTENT[word] for word in words if word in _CONTENT)


def _common_end(a: Sequence[str], b: Sequence[str]) -> int:
    count = 0
    while count < min(len(a), len(b)) and a[-1 - count] == b[-1 - count]:
        count += 1
    return count


def _reduction(name: str) -> int:
    """The downscaling factor that the name of an image folder states: 4 for images_4, 1 for other names."""
    matched = _DOWNSCALED.fullmatch(name.casefold())
    return int(matched[1]) if matched else 1
