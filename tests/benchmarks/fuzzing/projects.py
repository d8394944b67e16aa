"""Project databases, and the job folders next to them."""

from __future__ import annotations

import sqlite3
from functools import cache
from pathlib import Path

import numpy as np
from capture_samples import room, walk, write_nerfstudio

from fuzzing.graphs import row
from fuzzing.places import workshop
from fuzzing.reader import Files, Reader, Seed, each, files_in
from nvsim.depth.cloud_file import write_cloud
from nvsim.depth.fusion import FusedCloud
from nvsim.events import Done, Failed, Log, Metric, Preview, Progress, Warning
from nvsim.graph.findings import check_graph
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.perception.support import FloorSupport
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig
from nvsim.project.floor_heights import floor_of
from nvsim.project.graph import context_of, recorded_config, thresholds_of
from nvsim.project.jobs.files import EventFile, event_line
from nvsim.project.jobs.joblist import JobList
from nvsim.project.layout import ADDED, CLOUD, Layout
from nvsim.project.project import Project
from nvsim.project.stages import imported
from nvsim.project.work import STAGES
from nvsim.submaps.split import Submap
from nvsim_app.jobs.history import JobReport
from nvsim_app.state.loading import ProjectReader
from nvsim_app.state.results import result_of_job


def readers() -> list[Reader]:
    return [
        Reader("project.db", _project, _contents, share=4),
        Reader("project.db written", _project, _written, disposable=True, share=2),
        Reader("job folder", _jobs, _listed, share=3),
        Reader("job events", _events, _heard, share=2),
    ]


@cache
def project_with_walk() -> Files:
    """A project without masks and models: capture, submaps, graph, floors, results, stages, and commands."""
    with workshop() as folder:
        source = write_nerfstudio(folder / "walk", walk(12), room(600))
        root = folder / "p.nvsim"
        with Project.create_or_open(root) as project:
            capture = imported.run(project, source, CaptureConfig(scale=1.0), lambda event: None)
            half = len(capture.frames) // 2
            cores = [tuple(range(half)), tuple(range(half, len(capture.frames)))]
            every = tuple(range(len(capture.frames)))
            project.set_submaps(tuple(Submap(i, c, every, capture.positions[list(c)]) for i, c in enumerate(cores)))
            graph: NavGraph = row()
            project.set_graph(graph)
            project.set_result("views", {"psnr": 27.5, "rows": [{"submap": 0, "ssim": 0.8}]})
            ledger.begin_part(project, "depth", "key of depth")
            one = np.ones((1, 3), np.float32)
            fused = FusedCloud(one, one.astype(np.uint8), one, np.ones(1, np.uint16))
            for name in (CLOUD, ADDED):
                write_cloud(root / "depth" / name, fused)
            ledger.finish(project, "depth", 1.0, {"capture": imported.capture_key(project)})
            for stage in ("submaps", "floors", "train", "map"):
                ledger.begin_part(project, stage, f"key of {stage}")
                ledger.finish(
                    project, stage, 1.5, recorded_config(MappingConfig()) if stage == "map" else {"psnr": 20.0}
                )
        database = root / "project.db"
        connection = sqlite3.connect(database)
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        connection.execute("PRAGMA journal_mode=DELETE")
        connection.close()
        _lay_floor(Layout(root))
        images = {n.removeprefix("walk/"): d for n, d in files_in(folder).items() if n.endswith(".png")}
        kept = ("project.db", "imported/", "depth/", "floor/", "cuts/")
        return {
            n: d for n, d in files_in(root).items() if n.startswith(kept) and not n.endswith(("-wal", "-shm"))
        } | images


def _lay_floor(layout: Layout) -> None:
    for submap in range(2):
        path = layout.surface(submap)
        path.parent.mkdir(exist_ok=True)
        heights = np.zeros((4, 5), np.float32)
        np.savez_compressed(path, heights=heights, origin=np.array([-1.0, -1.0]), spacing=np.array(1.0))
    FloorSupport(np.ones((30, 30), bool), (-1.2, -1.2), 0.08).save(layout.support)


def _project() -> list[Seed]:
    """A project without floors, from which the window would build an occupancy map in another process."""
    names = ("project.db", "imported/", "depth/", "cuts/")
    files = {n: d for n, d in project_with_walk().items() if n.startswith(names)}
    return each(files, "", {"project.db": "sqlite"})


def _contents(path: Path) -> object:
    """Reads everything that the window and the commands read from a database."""
    with Project.open(path) as project:
        project.results(), project.submaps(), project.graph(), project.scene()
        project.scan_name, thresholds_of(project), imported.capture_config(project)
        for stage in STAGES:
            ledger.record(project, stage)
        project.scan()
        context, graph = context_of(project), project.graph()
        floor_of(project)
        if graph is not None:
            check_graph(graph, context)
    reader = ProjectReader(path)
    try:
        return list(reader.updates())[-1:]
    finally:
        reader.close()


def _written(path: Path) -> object:
    """Writes to a project as a command does."""
    with Project.open(path, writable=True) as project:
        ledger.begin_part(project, "map", "another")
        ledger.finish(project, "map", 1.0, {})
        project.set_graph(row())
        project.set_result("graph", {"a": 1})
        project.set_submaps(())
        return project.graph()


def _job_files() -> Files:
    with workshop() as root:
        jobs = JobList(root)
        for verb in ("map", "train", "evaluate views"):
            jobs.add(verb, ["--project", "x"], f"A {verb}")
        first = jobs.claim(1)
        assert first is not None
        jobs.finish(first, 0, "")
        events = (
            *(Progress("train", k, 5, "step") for k in range(3)),
            *(Metric("train", "psnr", k, 20.0 + k) for k in range(2)),
            *(Preview("train", "a.jpg"), Log("x", "train"), Warning("w", "train"), Done("train", "w", {"a": 1})),
            Failed("train", "no", 2),
        )
        first.events.write_text("".join(event_line(e, 1000.0 + k) for k, e in enumerate(events)))
        first.output.write_text('{"psnr": 20.5, "rows": [{"a": 1}, {"a": 2, "b": "x"}]}\n')
        first.messages.write_text("nothing\n")
        (first.folder / "wish").write_text("pause")
        return {n: d for n, d in files_in(root).items() if not n.endswith(".lock")}


def _jobs() -> list[Seed]:
    files = _job_files()
    forms = {"order.json": "json", "standing.json": "json", "output.txt": "json", "wish": "text", "ran.txt": "text"}
    found = {n: forms[n.rpartition("/")[2]] for n in files if n.rpartition("/")[2] in forms}
    return each(files, "", found)


def _listed(path: Path) -> object:
    """Lists jobs as the window does, without acting on them."""
    jobs = JobList(path)
    return [(j, result_of_job(j)) for j in jobs.jobs()]


def _events() -> list[Seed]:
    files = _job_files()
    target = next(n for n in files if n.endswith("events.jsonl"))
    return each(files, target, {target: "lines of json"})


def _heard(path: Path) -> object:
    """Follows a job as the window does: every event goes to its log, its curves, and its progress."""
    file, history = EventFile(path), JobReport()
    while file.has_unread_events:
        for at, event in file.read():
            history.receive(at, event)
    return history.share, history.rate, history.seconds_left
