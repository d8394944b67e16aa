"""The results of all stages as one frozen value, and its only reader and writer.

When a stage runs again, its new result is made in a numbered folder beside the old one. One transaction puts it to use
when it is finished. A kill at any time therefore leaves a complete result in use. The replaced result is kept, one per
stage, until the next result replaces it or a user deletes it.
"""

from __future__ import annotations

import json
import re
import shutil
import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from nvsim.errors import InputError
from nvsim.files import tables
from nvsim.files.tables import COUNT, NUMBER, TEXT
from nvsim.project.layout import Layout, model_name
from nvsim.project.work import FROM_A_CUT, STAGE, STAGES, StageName

Slot = Literal["in use", "previous", "next"]
"""previous: the result before the one in use. next: models of another cut than those in use, until each submap has
one."""
CONTENT = "capture"
"""Key in the summary of a part. Its value identifies the content that the part was computed from, see
`ledger.content_key`."""
NOWHERE = "models/none"
"""The place of a model or depth that a result does not have."""
_GRAPH = re.compile(r"kept/graph\.\d+")
_PLACE = re.compile(
    rf"((imported|depth|masks|floor|models/submap_\d{{3,}})(\.\d+)?|models/none|cuts/\d+\.npz|{_GRAPH.pattern})"
)
_NAME = re.compile(r"imported|depth|masks|floor|models/submap_\d{3,}|cut/(submaps|floors|train)")
_MADE = re.compile(r"(imported|depth|masks|floor|submap_\d{3,})(\.\d+)?|\d+\.npz|graph\.\d+")
_NAMES = {"import": ("imported",), "depth": ("depth",), "floors": ("masks", "floor")}
_FINISHED = {"imported": "capture.json", "depth": "cloud.ply", "floor": "support.npz", "models": "model.json"}


@dataclass(frozen=True)
class StagePart:
    """A finished part of a stage.

    key       hash of everything that it depends on
    seconds   duration of the work
    finished  seconds since the epoch
    figures   summary as JSON
    version   version of NVSim that made it; "" if it did not store its version
    settings  options as JSON, if later stages read them
    batch     see `ledger.add_model`
    """

    key: str
    seconds: float = 0.0
    finished: float = 0.0
    figures: str = "{}"
    version: str = ""
    settings: str = ""
    batch: str = ""

    @property
    def summary(self) -> dict[str, Any]:
        """The figures of the stage. Raises InputError if they are damaged."""
        try:
            found = json.loads(self.figures)
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise InputError("The database of the project is damaged: a stage has no summary; run the stage again.")
        return found


@dataclass(frozen=True)
class StageResult:
    """One finished result of a stage: number -> part, and name of a file or folder -> its place in the project."""

    parts: Mapping[int, StagePart] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class UnfinishedPart:
    """A part that is being made: the key of its inputs, and the number of its generation."""

    key: str
    number: int = 0


@dataclass(frozen=True)
class StageResults:
    """The results of all stages. A change returns a new value; `write` commits it.

    results     (slot, stage) -> result
    unfinished  (stage, part) -> part that is being made
    generation  the last number that was assigned
    """

    results: Mapping[tuple[Slot, str], StageResult] = field(default_factory=dict)
    unfinished: Mapping[tuple[str, int], UnfinishedPart] = field(default_factory=dict)
    generation: int = 0

    # Questions --------------------------------------------------------------------------------------------------

    def get(self, slot: Slot, stage: str) -> StageResult | None:
        return self.results.get((slot, stage))

    def part(self, stage: str, part: int = 0) -> StagePart | None:
        """A part of the result in use, even while it is being made again; None if it was never finished."""
        return self.results.get(("in use", stage), StageResult()).parts.get(part)

    @property
    def places(self) -> dict[str, str]:
        """Name -> place of all files in use; a missing name means that the place equals the name."""
        return {n: p for (slot, _), r in self.results.items() if slot == "in use" for n, p in r.files.items()}

    @property
    def depth(self) -> StagePart | None:
        """The depth in use. None if it was never estimated, was skipped, or belongs to another capture than the present
        one. Raises InputError if its summary is damaged."""
        found, imported = self.part("depth"), self.part("import")
        if found is None or imported is None or "skipped" in found.summary:
            return None
        return found if found.summary.get(CONTENT) == imported.key else None

    @property
    def finished_stages(self) -> frozenset[StageName]:
        """The stages that finished."""
        return frozenset(stage for stage in STAGES if self.results.get(("in use", stage), StageResult()).parts)

    def outdated(self, content: str) -> frozenset[StageName]:
        """The stages in `finished_stages` that were computed from other content than `content`, the present one by
        `ledger.content_key`; none if it is "". Raises InputError if a summary is damaged."""
        return frozenset(
            stage
            for stage in self.finished_stages
            if content
            and any(self._is_outdated(part, content) for part in self.results["in use", stage].parts.values())
        )

    def _is_outdated(self, part: StagePart, content: str) -> bool:
        made_from = part.summary.get(CONTENT)
        if made_from is not None:
            return bool(made_from != content)
        # Earlier versions did not record the content. Their results are compared with the time of the import.
        imported = self.part("import")
        return imported is not None and 0 < part.finished < imported.finished

    @property
    def stages_of_previous_cut(self) -> frozenset[StageName]:
        """The stages whose result in use belongs to a previous cut into submaps."""
        places = self.places
        newest = places.get("cut/submaps")
        return frozenset(stage for stage in FROM_A_CUT if places.get(f"cut/{stage}", newest) != newest)

    @property
    def restorable_stages(self) -> frozenset[StageName]:
        """The stages with an earlier result that can be restored."""
        return frozenset(stage for stage in STAGES if ("previous", stage) in self.results)

    def in_use(self, stage: str, root: Path) -> StageResult | None:
        """The complete result of a stage in use, with all its files; None if there is none."""
        found, places = self.results.get(("in use", stage), StageResult()), self.places
        names: Iterable[str] = _NAMES.get(stage, ())
        if stage == "train":
            # Older versions did not store places. Models that wait for others or are being made are not in use.
            other = self.all_places() - set(places.values())
            on_disk = {f"models/{p}" for p in _models(root)} - other
            models = sorted({n for n in places if n.startswith("models/")} | on_disk)
            names = [n for n in models if (root / places.get(n, n) / "model.json").is_file()]
            if not names:
                return None
        elif not found.parts:
            return None
        # The floors of splat files have no masks.
        files = {n: places.get(n, n) for n in names if n in places or (root / n).exists()}
        return StageResult(found.parts, files | {n: p for n, p in found.files.items() if n == f"cut/{stage}"})

    def made_at(self, stage: str, part: int = 0) -> dict[str, str]:
        """Name -> place of the files that are being made."""
        number = self.unfinished.get((stage, part), UnfinishedPart("")).number
        return {name: f"{name}.{number}" if number else name for name in _names_of(stage, part)}

    def all_places(self) -> set[str]:
        """All places with references."""
        finished = {p for result in self.results.values() for p in result.files.values()}
        return finished | {p for stage, part in self.unfinished for p in self.made_at(stage, part).values()}

    # Changes ----------------------------------------------------------------------------------------------------

    def with_result(self, slot: Slot, stage: str, result: StageResult | None) -> StageResults:
        """With `result` in this slot, or without one."""
        others = {k: r for k, r in self.results.items() if k != (slot, stage)}
        return replace(self, results=others if result is None else {**others, (slot, stage): result})

    def with_content(self, stage: str, content: str) -> StageResults:
        """With `content` as the content that the result of a stage in use was computed from."""
        result = self.results["in use", stage]
        parts = {n: replace(p, figures=json.dumps({**p.summary, CONTENT: content})) for n, p in result.parts.items()}
        return self.with_result("in use", stage, replace(result, parts=parts))

    def completed(self, slot: Slot, stage: str, files: Mapping[str, str]) -> StageResults:
        """With these files of a result, if it does not have them."""
        found = self.results.get((slot, stage), StageResult())
        return self.with_result(slot, stage, StageResult(found.parts, {**files, **found.files}))

    def numbered(self) -> StageResults:
        """With the number of the next generation."""
        return replace(self, generation=self.generation + 1)

    def with_unfinished_part(self, stage: str, part: int, key: str, root: Path) -> StageResults:
        """With a part that is being made for `key`, at its own name if that is free, else at a numbered one."""
        names, places = _names_of(stage, part), self.places
        taken = self.part(stage, part) is not None
        occupied = any(n in places or (root / n / _FINISHED.get(n.split("/")[0], "-")).is_file() for n in names)
        new = self.numbered() if names and (taken or occupied) else self
        work = UnfinishedPart(key, 0 if new is self else new.generation)
        return replace(new, unfinished={**self.unfinished, (stage, part): work})

    def without_unfinished(self, stage: str, *parts: int) -> StageResults:
        """Without the unfinished work on these parts."""
        gone = {(stage, part) for part in parts}
        return replace(self, unfinished={k: u for k, u in self.unfinished.items() if k not in gone})

    def finished(
        self, stage: str, parts: Mapping[int, StagePart], files: Mapping[str, str], before: StageResult | None
    ) -> StageResults:
        """With new `parts` and `files` of a stage in use, and `before` as the previous result if it is not None."""
        found = self.results.get(("in use", stage), StageResult())
        new = self.with_result("in use", stage, StageResult({**found.parts, **parts}, {**found.files, **files}))
        return (new if before is None else new.with_result("previous", stage, before)).without_unfinished(stage, *parts)

    def with_result_in_use(self, stage: str, result: StageResult) -> StageResults:
        """With `result` in use in place of the present one."""
        files = dict(result.files)
        files.pop("graph", None)  # a kept graph is a file, the graph in use is in the database
        parts = result.parts
        if stage == "train":
            parts = {index: replace(part, batch="") for index, part in parts.items()}  # the next model starts a batch
            # A folder without a number may belong to the replaced result.
            gone = {n for n in {*self.places, *self.all_places()} if n.startswith("models/")} - {NOWHERE}
            files = {name.split(".")[0]: NOWHERE for name in gone} | files
        return self.with_result("in use", stage, StageResult(parts, files))


def _names_of(stage: str, part: int) -> tuple[str, ...]:
    """The names of the folders of a part of a stage."""
    return (model_name(part),) if stage == "train" else _NAMES.get(stage, ()) if part == 0 else ()


def first_outdated_stage(
    outdated: frozenset[StageName], former: frozenset[StageName], content: str = "capture"
) -> tuple[StageName, str] | None:
    """The first stage with a result of another content or cut than the present one, and a sentence about it; None if
    there is none. `content` is "capture" or "splat"."""
    for stage in STAGES:
        if stage in outdated:
            return stage, STAGE[stage].outdated(content)
        if stage in former:
            return stage, STAGE[stage].from_previous_cut
    return None


# The database --------------------------------------------------------------------------------------------------------

_KEPT = {"slot": TEXT, "stage": TEXT, "part": COUNT}
_PART = {"key": TEXT, "seconds": NUMBER, "finished": NUMBER, "figures": TEXT}
_ABOUT = {"version": TEXT, "settings": TEXT, "batch": TEXT}
_FILE = {"slot": TEXT, "stage": TEXT, "name": TEXT, "place": TEXT}
_UNFINISHED = {"stage": TEXT, "part": COUNT, "key": TEXT, "number": COUNT}


def read(c: sqlite3.Connection, path: Path) -> StageResults:
    """The results of all stages in the database at `path`. Raises InputError if it is damaged."""
    parts: dict[tuple[Slot, str], dict[int, StagePart]] = {}
    files: dict[tuple[Slot, str], dict[str, str]] = {}
    for slot, stage, part, *cells in tables.read(c, path, "stage_parts", _KEPT | _PART | _ABOUT):
        parts.setdefault((slot, stage), {})[part] = StagePart(*cells)
    for slot, stage, name, place in tables.read(c, path, "stage_files", _FILE):
        files.setdefault((slot, stage), {}).update(files_inside_project({name: place}))
    results = {key: StageResult(parts.get(key, {}), files.get(key, {})) for key in dict.fromkeys([*parts, *files])}
    unfinished = {(s, p): UnfinishedPart(*work) for s, p, *work in tables.read(c, path, "unfinished", _UNFINISHED)}
    generation = max((n for (n,) in tables.read(c, path, "generation", {"number": COUNT})), default=0)
    return StageResults(results, unfinished, generation)


def read_places(c: sqlite3.Connection) -> dict[str, str]:
    """`StageResults.places` alone, for the paths of a project."""
    return files_inside_project(dict(c.execute("SELECT name, place FROM stage_files WHERE slot = 'in use'")))


def write(c: sqlite3.Connection, value: StageResults) -> None:
    """Replaces the results of all stages. Call it inside a transaction."""
    parts = [(*key, n, *astuple(part)) for key, result in value.results.items() for n, part in result.parts.items()]
    files = [(*key, *file) for key, result in value.results.items() for file in result.files.items()]
    work = [(*key, *astuple(work)) for key, work in value.unfinished.items()]
    for table, rows in (
        ("stage_parts", parts),
        ("stage_files", files),
        ("unfinished", work),
        ("generation", [(value.generation,)]),
    ):
        c.execute(f"DELETE FROM {table}")
        for row in rows:
            c.execute(f"INSERT INTO {table} VALUES ({', '.join('?' * len(row))})", row)


def files_inside_project(files: Mapping[str, Any]) -> dict[str, str]:
    """The files inside the project, because projects may come from other people. A kept graph elsewhere is missing."""
    texts = {n: p for n, p in files.items() if isinstance(n, str) and isinstance(p, str)}
    found = {n: p for n, p in texts.items() if _NAME.fullmatch(n) and _PLACE.fullmatch(p)}
    if "graph" in files:
        found["graph"] = files["graph"] if _GRAPH.fullmatch(str(files["graph"])) else NOWHERE
    return found


# Files ---------------------------------------------------------------------------------------------------------------


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


def remove_unreferenced_files(value: StageResults, root: Path) -> None:
    """Removes generations without references: deleted results, and leftovers of killed processes. Only the writer may
    call it."""
    wanted, named = value.all_places(), value.places
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


def bytes_of(root: Path, result: StageResult, but: StageResult | None = None) -> int:
    """Bytes of the files of a result, without those that `but` has too."""
    own = set(result.files.values()) - (set() if but is None else set(but.files.values()))
    paths = [root / place for place in own]
    files = [f for p in paths for f in (p.rglob("*") if p.is_dir() else [p])]
    return sum(f.stat().st_size for f in files if f.is_file())
