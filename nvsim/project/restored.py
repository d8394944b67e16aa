"""Lists, restores and deletes the previous result of each stage."""

from __future__ import annotations

from dataclasses import dataclass, replace

from nvsim.errors import InputError
from nvsim.files.regular import read_bytes
from nvsim.graph.store import decode_graph
from nvsim.project import ensemble, graph_table, results
from nvsim.project.cuts import load_cut
from nvsim.project.graph_files import graph_in_file
from nvsim.project.project import Project
from nvsim.project.replaced import describe
from nvsim.project.results import Result
from nvsim.project.work import STAGES


@dataclass(frozen=True)
class Kept:
    """A result that can be restored: its stage, its description, and its size on disk in bytes."""

    stage: str
    words: str
    bytes: int


def megabytes(bytes: int) -> str:
    """A size in words: "12 MB"."""
    return f"{bytes / 1e6:,.0f} MB" if bytes >= 1e6 else f"{bytes / 1e3:,.0f} kB"


def kept_results(project: Project) -> tuple[Kept, ...]:
    """The results that can be restored, at most one per stage, in the order of the stages."""
    found = []
    for stage in STAGES:
        result = results.kept(project.connection, stage)
        if result is not None:
            now = results.in_use(project.connection, project.root, stage)
            found.append(Kept(stage, describe(result, stage), results.bytes_of(project.root, result, now)))
    return tuple(found)


def restore(project: Project, stage: str) -> str:
    """Restores the previous result of a stage and keeps the present one in its place, so that a second call restores
    the present one. Returns a description of the restored result. All changes are one transaction.

    Raises InputError if there is no previous result, or its files are missing or damaged.
    """
    c, before = project.connection, need_kept(project, stage)
    missing = sorted(p for p in before.places.values() if p != results.NOWHERE and not (project.root / p).exists())
    if missing:
        raise InputError(f"{project.root / missing[0]} is missing, so the last result of {stage} cannot be restored.")
    if stage in ("import", "submaps"):
        project.fix_cut()
    now = results.in_use(c, project.root, stage)
    if now is not None:
        now = replace(now, values={**now.values, **(graph_in_file(project) if stage == "map" else {})})
    cut = before.places.get("cut/submaps")
    submaps = None if stage != "submaps" or cut is None else load_cut(project.root / cut)
    graph = None
    if stage == "map" and "graph" in before.values:
        graph = decode_graph(read_bytes(project.root / results.graph_place(before)))
    with project.transaction():
        results.put_to_use(c, stage, before)
        results.keep(c, stage, now)
        if submaps is not None and cut is not None:
            project.write_submaps(c, submaps, cut)
        if graph is not None:
            graph_table.write(c, graph)
        if stage == "train":
            ensemble.forget_batch(c)
    results.tidy(c, project.root)
    if submaps is not None:
        from nvsim.submaps.picture import draw_submaps

        draw_submaps(project.need_capture().positions, submaps, project.layout.pictures / "submaps.png")
    return describe(before, stage)


def discard(project: Project, stage: str) -> int:
    """Deletes the previous result of a stage; the result in use stays. Returns the freed bytes. Raises InputError if
    there is no previous result."""
    c, before = project.connection, need_kept(project, stage)
    freed = results.bytes_of(project.root, before, results.in_use(c, project.root, stage))
    with project.transaction():
        results.keep(c, stage, None)
    results.tidy(c, project.root)
    return freed


def need_kept(project: Project, stage: str) -> Result:
    """The previous result of a stage. Raises InputError if there is none."""
    found = results.kept(project.connection, stage)
    if found is None:
        raise InputError(f"{project.root} keeps no earlier result of {stage}; run the stage again to have one.")
    return found
