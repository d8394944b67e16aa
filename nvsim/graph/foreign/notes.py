"""A user's notes on a connectivity file, for which its format has no place, and the name of its original. Stored as
SCAN_review.json in the folder of the file."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.regular import read_json
from nvsim.graph.connectivity import SUFFIX
from nvsim.graph.foreign.original import Original
from nvsim.graph.types import NavGraph

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


def read_original(path: Path) -> Original | None:
    """Return the original that the notes name; None if there is none."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))["original"]
        name, written = str(kept["name"]), str(kept["written"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return Original(name, written) if Path(name).name == name else None


def write_notes(graph: NavGraph, path: Path, original: Original | None = None) -> None:
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
