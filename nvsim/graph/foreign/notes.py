"""The files that NVSim keeps beside an edited connectivity file: the user's notes, and the original of the file.

Notes are stored as SCAN_review.json, because the format of the connectivity file has no place for them. The original is
NAME.json~, or NAME.json.~1~ and so on: existing files are never overwritten. Only content that NVSim did not write is
an original, so the notes record the digest of NVSim's last write. Another save by NVSim leaves the original unchanged.
Content that another program wrote is kept as well."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import shutil
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import read_json
from nvsim.graph.connectivity import SUFFIX
from nvsim.graph.paths import components
from nvsim.graph.types import NavGraph


@dataclass(frozen=True)
class KeptOriginal:
    """A kept original.

    name     its file name, in the folder of the edited file
    written  SHA-256 of NVSim's last write to the edited file
    """

    name: str
    written: str


def keep_original(path: Path, known: KeptOriginal | None, digest: str) -> KeptOriginal | None:
    """Copy the file at `path` before text of SHA-256 `digest` replaces it. Nothing is copied if NVSim wrote the file or
    if the content does not change. Returns the record for the notes. Raises OSError if copying fails."""
    if not path.is_file():
        return known
    held = hashlib.sha256(path.read_bytes()).hexdigest()
    if held == digest:
        return known
    if known is not None and known.written == held and (path.parent / known.name).is_file():
        return KeptOriginal(known.name, digest)
    return KeptOriginal(_write_backup(path).name, digest)


def _write_backup(path: Path) -> Path:
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


def saving_message(path: Path, original: Path | None, graph: NavGraph) -> str:
    """Return a message: the saved file, the name of its original, and the number of components of the graph if there
    are several."""
    words = f"Saved {path.name}."
    if original is not None:
        words += f" The original is kept as {original.name}."
    return f"{words} {disconnected_warning(graph)}".rstrip()


def disconnected_warning(graph: NavGraph) -> str:
    """Return a sentence if some viewpoints cannot reach others; "" otherwise."""
    groups = components(graph)
    if len(groups) < 2:
        return ""
    sizes = ", ".join(str(len(group)) for group in groups[:4]) + (", …" if len(groups) > 4 else "")
    return f"The graph has {len(groups)} disconnected islands ({sizes} viewpoints)."


_MARKS = ("reviewed", "locked")


def notes_path(path: Path) -> Path:
    """Return the path of the notes of a connectivity file."""
    name = path.name.removesuffix(SUFFIX) if path.name.endswith(SUFFIX) else path.stem
    return path.parent / f"{name}_review.json"


def read_notes(graph: NavGraph, path: Path) -> NavGraph:
    """Return the graph with its marks and ignored findings. Notes about missing elements are ignored. Raises InputError
    if the notes cannot be read."""
    if not os.path.lexists(path):
        return graph
    then = "repair the file or move it away"
    notes = read_json(path, "a file of notes about a graph", then)
    if not isinstance(notes, dict):
        raise InputError(f"{path} holds no notes about a graph; {then}.")
    try:
        ignored = {str(key): str(reason) for key, reason in notes.get("ignored", {}).items()}
        viewpoints, edges = dict(graph.viewpoints), dict(graph.edges)
        for mark in _MARKS:
            marked: dict[str, Any] = {mark: True}
            for id in _strings(notes.get(mark, {}).get("viewpoints", [])):
                if id in viewpoints:
                    viewpoints[id] = replace(viewpoints[id], **marked)
            for a, b in notes.get(mark, {}).get("edges", []):
                if (a, b) in edges:
                    edges[a, b] = replace(edges[a, b], **marked)
    except (ValueError, TypeError, AttributeError) as error:
        raise InputError(f"Cannot read the notes in {path} ({error}); repair the file or move it away.") from error
    return replace(graph, viewpoints=viewpoints, edges=edges, ignored=ignored)


def read_original(path: Path) -> KeptOriginal | None:
    """Return the original that the notes name; None if there is none."""
    try:
        kept = read_json(path, "notes", "repair the file or move it away")["original"]
        name, written = str(kept["name"]), str(kept["written"])
    except (InputError, KeyError, TypeError):
        return None
    return KeptOriginal(name, written) if Path(name).name == name else None


def write_notes(graph: NavGraph, path: Path, original: KeptOriginal | None = None) -> None:
    """Write the notes. If there is nothing to note, the file is deleted."""
    notes: dict[str, Any] = {"ignored": dict(graph.ignored)} if graph.ignored else {}
    for mark in _MARKS:
        found = {
            "viewpoints": [id for id, v in graph.viewpoints.items() if getattr(v, mark)],
            "edges": [list(key) for key, e in graph.edges.items() if getattr(e, mark)],
        }
        if any(found.values()):
            notes[mark] = found
    if original is not None:
        notes["original"] = asdict(original)
    if notes:
        atomic.write_text(path, json.dumps(notes, indent=1) + "\n")
    else:
        path.unlink(missing_ok=True)


def _strings(values: Iterable[Any]) -> list[str]:
    return [value for value in values if isinstance(value, str)]
