"""Tracks which results of the stages are in use, and the previous result of each stage.

When a stage runs again, its new result is made in a numbered folder beside the old one. One transaction puts it to use
when it is finished. A kill at any time therefore leaves a complete result in use. The replaced result is kept, one per
stage, until the next result replaces it or a user deletes it. The table `meta` stores:

    places           name of a result -> its place in use; a missing name means that the place equals the name
    previous STAGE   the Result before the one in use
    next train       models of another cut than those in use, until each submap has one
    work STAGE PART  unfinished work: key of its inputs, number of its generation
    generation       the last number that was assigned
"""

from __future__ import annotations

import json
import re
import shutil
import sqlite3
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from nvsim.errors import InputError, shown
from nvsim.files.guarded_database import damaged
from nvsim.project.layout import Layout, model_name
from nvsim.project.work import STAGES

NOWHERE = "models/none"
"""The place of a model or depth that a result does not have."""
_PLACE = re.compile(
    r"((imported|depth|masks|floor|models/submap_\d{3,})(\.\d+)?|models/none|cuts/\d+\.npz|kept/graph\.\d+)"
)
_GRAPH = re.compile(r"kept/graph\.\d+")
_NAME = re.compile(r"imported|depth|masks|floor|models/submap_\d{3,}|cut/(submaps|floors|train)")
_MADE = re.compile(r"(imported|depth|masks|floor|submap_\d{3,})(\.\d+)?|\d+\.npz|graph\.\d+")
_NAMES = {"import": ("imported",), "submaps": (), "depth": ("depth",), "floors": ("masks", "floor"), "map": ()}
_FINISHED = {"imported": "capture.json", "depth": "cloud.ply", "floor": "support.npz", "models": "model.json"}


@dataclass(frozen=True)
class Row:
    """The record of a finished part of a stage: `finished` is in seconds since the epoch."""

    key: str
    seconds: float
    finished: float
    summary: dict[str, Any]


@dataclass(frozen=True)
class Result:
    """One finished result of a stage: part -> row, name -> place, and other values that restoring it needs."""

    rows: dict[int, Row] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)
    values: dict[str, str] = field(default_factory=dict)


# Meta ----------------------------------------------------------------------------------------------------------------


def value(c: sqlite3.Connection, key: str) -> str | None:
    """The value in the table meta, None if there is none."""
    row = c.execute("SELECT value FROM meta WHERE key = ?", (key,)).fetchone()
    return None if row is None else str(row[0])


def put(c: sqlite3.Connection, key: str, text: str | None) -> None:
    """Stores a value, or removes it if `text` is None. Call it inside a transaction."""
    if text is None:
        c.execute("DELETE FROM meta WHERE key = ?", (key,))
    else:
        c.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, text))


def _parsed(c: sqlite3.Connection, key: str) -> dict[str, Any]:
    text = value(c, key)
    try:
        found = json.loads(text) if text else {}
    except ValueError:
        found = {}
    return found if isinstance(found, dict) else {}


# Places --------------------------------------------------------------------------------------------------------------


def places(c: sqlite3.Connection) -> dict[str, str]:
    """Name -> place of each result in use. Skips places outside the project, because projects may come from other
    people."""
    return _trusted(_parsed(c, "places"))


def _trusted(found: Any) -> dict[str, str]:
    items = found.items() if isinstance(found, dict) else ()
    return {n: p for n, p in items if isinstance(p, str) and _PLACE.fullmatch(p) and _NAME.fullmatch(n)}


def put_places(c: sqlite3.Connection, found: dict[str, str]) -> None:
    put(c, "places", json.dumps(found))


def layout_of(root: Path) -> Layout:
    """The layout of a project with its results in use. The project need not be open."""
    plain = Layout(root)
    try:
        from nvsim.project import database

        connection = database.connect(plain.database, read_only=True)
    except Exception:  # not a readable project: the error is reported when it is opened
        return plain
    try:
        return Layout(root, tuple(places(connection).items()))
    except sqlite3.Error:
        return plain
    finally:
        connection.close()


def is_former(c: sqlite3.Connection, stage: str) -> bool:
    """Whether the floors or models in use belong to an older cut than the newest."""
    found = places(c)
    newest = found.get("cut/submaps")
    return found.get(f"cut/{stage}", newest) != newest


# Numbers -------------------------------------------------------------------------------------------------------------


def new_number(c: sqlite3.Connection) -> int:
    """The number of the next generation. Call it inside a transaction."""
    number = int(value(c, "generation") or 0) + 1
    put(c, "generation", str(number))
    return number


def numbered(name: str, number: int) -> str:
    """The place of a generation of a result; generation 0 has no number in its name."""
    return name if number == 0 else f"{name}.{number}"


def names_of(stage: str, part: int) -> tuple[str, ...]:
    """The names of the results of a part of a stage."""
    return (model_name(part),) if stage == "train" else _NAMES.get(stage, ()) if part == 0 else ()


def begin_work(c: sqlite3.Connection, root: Path, stage: str, part: int, key: str) -> None:
    """Records that a part is being made for `key`, and its place: its own name if that is free, else a numbered one."""
    names, found = names_of(stage, part), places(c)
    taken = c.execute("SELECT 1 FROM stages WHERE stage = ? AND part = ? AND state = 'done'", (stage, part)).fetchone()
    occupied = any(n in found or (root / n / _FINISHED.get(n.split("/")[0], "-")).is_file() for n in names)
    number = new_number(c) if names and (taken or occupied) else 0
    put(c, f"work {stage} {part}", json.dumps({"key": key, "number": number}))


def work(c: sqlite3.Connection, stage: str, part: int) -> tuple[str, int] | None:
    """Key and generation number of unfinished work, None if there is none."""
    found = _parsed(c, f"work {stage} {part}")
    try:
        return str(found["key"]), int(found["number"])
    except (KeyError, TypeError, ValueError):
        return None


def works(c: sqlite3.Connection) -> list[tuple[str, int]]:
    """Stage and part of all unfinished work."""
    rows = [str(k).split(" ") for (k,) in c.execute("SELECT key FROM meta WHERE key LIKE 'work % %'")]
    return [(r[1], int(r[2])) for r in rows if len(r) == 3 and r[2].isdigit()]


def drop_work(c: sqlite3.Connection, stage: str, part: int) -> None:
    put(c, f"work {stage} {part}", None)


def made_at(c: sqlite3.Connection, stage: str, part: int = 0) -> dict[str, str]:
    """Name -> place of the results that are being made."""
    found = work(c, stage, part)
    return {name: numbered(name, found[1] if found else 0) for name in names_of(stage, part)}


# Results -------------------------------------------------------------------------------------------------------------


def rows_of(c: sqlite3.Connection, stage: str) -> dict[int, Row]:
    """The finished parts in use. Raises InputError if a summary is damaged."""
    found = c.execute(
        "SELECT part, key, seconds, finished, summary FROM stages WHERE stage = ? AND state = 'done'", (stage,)
    )
    try:
        rows = {part: Row(key, seconds, at or 0.0, json.loads(text)) for part, key, seconds, at, text in found}
        if not all(isinstance(row.summary, dict) for row in rows.values()):
            raise ValueError("a summary that is not an object")
        return rows
    except ValueError as error:
        raise damaged(getattr(c, "path", Path("The database of the project")), error) from error


def put_rows(c: sqlite3.Connection, stage: str, rows: dict[int, Row]) -> None:
    """Replaces the rows of a stage."""
    c.execute("DELETE FROM stages WHERE stage = ?", (stage,))
    for part, row in rows.items():
        put_row(c, stage, part, row)


def put_row(c: sqlite3.Connection, stage: str, part: int, row: Row) -> None:
    c.execute(
        "INSERT OR REPLACE INTO stages (stage, part, key, state, seconds, finished, summary) "
        "VALUES (?, ?, ?, 'done', ?, ?, ?)",
        (stage, part, row.key, row.seconds, row.finished, json.dumps(row.summary)),
    )


def in_use(c: sqlite3.Connection, root: Path, stage: str) -> Result | None:
    """The result of a stage in use; None if there is none."""
    rows, found = rows_of(c, stage), places(c)
    names = list(_NAMES.get(stage, ()))
    if stage == "train":
        names = sorted({n for n in found if n.startswith("models/")} | {f"models/{p}" for p in _models(root)})
        names = [n for n in names if (root / found.get(n, n) / "model.json").is_file()]
        if not names:
            return None
    elif not rows:
        return None
    own = {n: found.get(n, n) for n in names}
    if f"cut/{stage}" in found:
        own[f"cut/{stage}"] = found[f"cut/{stage}"]
    values = {}
    if stage == "import":
        values = {"capture_config": value(c, "capture_config") or ""}
    return Result(rows, own, values)


def model_folders(layout: Layout) -> dict[int, Path]:
    """Submap -> folder of its model in use, for the submaps that have one."""
    names = {name for name, _ in layout.places if name.startswith("models/")}
    names |= {f"models/{name}" for name in _models(layout.root)}
    names |= {f"models/{name}" for name in _models(layout.imported)}
    indices = sorted(int(name.removeprefix("models/submap_")) for name in names)
    folders = {index: layout.model(index) for index in indices}
    return {index: folder for index, folder in folders.items() if (folder / "model.json").is_file()}


def _models(root: Path) -> list[str]:
    return [p.parent.name for p in root.glob("models/submap_*/model.json") if p.parent.name[7:].isdecimal()]


def put_to_use(c: sqlite3.Connection, stage: str, result: Result) -> None:
    """Makes `result` the one in use: its rows and places. Other tables must be written by the caller."""
    found = places(c)
    if stage == "train":
        gone = {n for n in found if n.startswith("models/")} | {p for p in _all_places(c) if p.startswith("models/")}
        found = {n: p for n, p in found.items() if not n.startswith("models/")}
        # A folder without a number may belong to the replaced result.
        found |= {name: NOWHERE for name in {p.split(".")[0] for p in gone} - {NOWHERE}}
    found.pop(f"cut/{stage}", None)
    put_places(c, {**found, **result.places})
    put_rows(c, stage, result.rows)
    if "capture_config" in result.values:
        put(c, "capture_config", result.values["capture_config"] or None)


def kept(c: sqlite3.Connection, stage: str, slot: str = "previous") -> Result | None:
    """The stored result of a stage that is not in use, None if there is none."""
    found = _parsed(c, f"{slot} {stage}")
    try:
        rows = {int(part): Row(**row) for part, row in found["rows"].items()}
        values = dict(found["values"])
        if not all(isinstance(text, str) for text in values.values()):
            return None
        if not all(isinstance(row.summary, dict) for row in rows.values()):
            return None
        return Result(rows, _trusted(found["places"]), values)
    except (KeyError, TypeError, ValueError, AttributeError):
        return None


def graph_place(result: Result) -> str:
    """The place of the graph file of a stored map. Raises InputError if it is not a graph file of the project, because
    projects may come from other people."""
    place = result.values["graph"]
    if not _GRAPH.fullmatch(place):
        raise InputError(
            f"The stored map names {shown(place)}, which is not a graph of this project; build the map again."
        )
    return place


def keep(c: sqlite3.Connection, stage: str, result: Result | None, slot: str = "previous") -> None:
    put(c, f"{slot} {stage}", None if result is None else json.dumps(asdict(result)))


# Files ---------------------------------------------------------------------------------------------------------------


def _all_places(c: sqlite3.Connection) -> set[str]:
    """All places with references."""
    found = set(places(c).values())
    for stage in STAGES:
        for slot in ("previous", "next"):
            result = kept(c, stage, slot)
            if result is not None:
                found |= set(result.places.values()) | {v for v in result.values.values() if _PLACE.fullmatch(v)}
    for name, part in works(c):
        found |= set(made_at(c, name, part).values())
    return found


def tidy(c: sqlite3.Connection, root: Path) -> None:
    """Removes generations without references: deleted results, and leftovers of killed processes. Only the writer may
    call it."""
    wanted, named = _all_places(c), places(c)
    for folder in (root, root / "models", root / "cuts", root / "kept"):
        for path in sorted(folder.glob("*")):
            if path.name.startswith(".") and path.name.endswith("-gone"):
                shutil.rmtree(path, ignore_errors=True)
                continue
            place = path.relative_to(root).as_posix()
            if not _PLACE.fullmatch(place) or not _MADE.fullmatch(path.name) or place in wanted:
                continue
            if "." not in place and place not in named:
                continue  # in use under its own name
            if path.is_dir() and not path.is_symlink():
                remove_folder(path)
            elif path.parent != root:
                path.unlink(missing_ok=True)


def remove_folder(path: Path) -> None:
    """Removes a folder that other processes may read: it is renamed first, so that it disappears as a whole."""
    gone = path.with_name(f".{path.name}-gone")
    shutil.rmtree(gone, ignore_errors=True)
    try:
        path.rename(gone)
    except OSError:
        gone = path
    shutil.rmtree(gone, ignore_errors=True)


def bytes_of(root: Path, result: Result, but: Result | None = None) -> int:
    """Bytes of the files of a result, without those that `but` has too."""
    other = set() if but is None else set(but.places.values())
    own = {*result.places.values(), *(v for v in result.values.values() if _PLACE.fullmatch(v))} - other
    paths = [root / place for place in own]
    files = [f for p in paths for f in (p.rglob("*") if p.is_dir() else [p])]
    return sum(f.stat().st_size for f in files if f.is_file())
