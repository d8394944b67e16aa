"""Exports a project as a scan: connectivity, strips with depth, views and floor plans, beside other scans.

`PreparedExport` is a checked export with its file locations and its estimate; it writes nothing.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numba
import numpy as np

from nvsim import __version__
from nvsim.cluster.piece import Executor
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Warning, ignore_event
from nvsim.files import atomic
from nvsim.files.atomic import as_input_error
from nvsim.files.locking import WriterLock
from nvsim.graph.connectivity import check_scan_id, write_connectivity
from nvsim.graph.exports import check_exportable
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.project.project import Project
from nvsim.r2r.observations import stub
from nvsim.r2r.observations.drawing import MADE, STAGE, ScanModels, draw_viewpoints, drawn_of, missing, write_unseen
from nvsim.r2r.observations.estimate import ExportEstimate, ScanCounts, estimate, shortage
from nvsim.r2r.observations.floor_plan import frame_of, storeys_with, write_plans
from nvsim.r2r.observations.layout import ScanPlaces, ScanSettings
from nvsim.r2r.observations.parts import split, write_parts
from nvsim.r2r.observations.record import ScanRecord, key_of, part_on_disk, refuse_foreign, remove_leftovers
from nvsim.r2r.observations.skybox import visible_from
from nvsim.render.backends import Backend, resolve_backend
from nvsim.splats.files import gaussian_count

PLANS, UNSEEN, GRAPH = "floor plans", "unseen directions", "connectivity"
"""Names of the parts of a scan that do not belong to one viewpoint."""
_ABOUT = {
    "frame": "meters, z up; every pose is level and faces +y; heading 0 is +y and grows to the right",
    "strips": "SCAN/matterport_skybox_images/ID_skybox_small.jpg: up, back, left, front, right, down; JPEG 4:4:4",
    "depth": "SCAN/matterport_skybox_images/ID_skybox_depth_small.png: 16 bits, 4000/meter along the ray, 0 is none",
    "unseen": "SCAN/matterport_skybox_images/ID_skybox_unseen_small.png: 255 for pixels that no training image shows",
    "views": "views/SCAN/ID/0.jpg to 35.jpg in the order of viewIndex: 640x480, 60 degrees high, absolute headings",
}


@dataclass(frozen=True, eq=False)
class PreparedExport:
    """An export that can begin.

    root    the folder of the export
    graph   the graph, with the scan id of the export
    parts   the graph itself, or its parts if it was split
    places  the file locations of each part
    """

    root: Path
    graph: NavGraph
    parts: tuple[NavGraph, ...]
    places: tuple[ScanPlaces, ...]
    source: ScanModels

    @staticmethod
    def of(
        project: Project, root: Path, scan: str | None = None, force: bool = False, most: int | None = None
    ) -> PreparedExport:
        """Checks an export.

        Raises InputError if a model or the graph is missing, the graph would fail in agents (unless `force`), or the
        folder is not writable or contains files that NVSim did not write.
        """
        graph = replace(project.need_graph(), scan=scan or project.scan_name)
        check_scan_id(graph.scan)
        if graph.scan == stub.SCAN:
            raise InputError(f"{stub.SCAN} is the name of the stub scan that agents need; choose another --scan.")
        if not force:
            check_exportable(graph)
        parts = (graph,) if most is None else tuple(split(graph, most))
        places = tuple(ScanPlaces(root, part.scan) for part in parts)
        for scan_places in places:
            refuse_foreign(scan_places)
        atomic.refuse_unwritable_folder(root)
        return PreparedExport(root, graph, parts, places, ScanModels.of(project, graph))

    def estimate(self, settings: ScanSettings, with_stub: bool, backend: Backend) -> ExportEstimate:
        """Estimates sizes and duration.

        Raises InputError if the backend is not available, or an existing manifest or a model description is damaged.
        """
        beside = stub.SCAN if with_stub and stub.needs_stub(self.places[0]) else ""
        on_card, cores = resolve_backend(backend) == "gsplat", numba.get_num_threads()
        return estimate(tuple(self._counts(settings, backend)), settings, cores=cores, on_card=on_card, stub=beside)

    @property
    def free(self) -> int:
        """Free bytes on the disk of the folder. Raises InputError if they cannot be determined."""
        try:
            return shutil.disk_usage(atomic.existing_parent(self.root)).free
        except OSError as error:
            raise as_input_error(self.root, error) from error

    def shortage(self, estimate: ExportEstimate) -> str:
        """Returns a warning if the disk is too small for the export, else ""."""
        return shortage(estimate.missing, self.free, self.root)

    def _counts(self, settings: ScanSettings, backend: Backend) -> Iterator[ScanCounts]:
        source = self.source
        gaussians = {i: gaussian_count(folder) for i, folder in source.folders.items()}
        for graph, places in zip(self.parts, self.places, strict=True):
            drawn = drawn_of(graph)
            record = ScanRecord(places, only_look=True)
            todo = len(drawn)
            if record.parts:  # otherwise all viewpoints are missing, and hashing the models is not needed
                todo = sum(1 for _ in missing(source, drawn, settings, record, backend))
            drawing = [gaussians[source.scene.nearest(np.array(v.position))] for v in drawn.values()]
            storeys = storeys_with(graph, source.submaps) if settings.plans else ()
            plans = tuple((frame.width, frame.height) for frame in (frame_of(graph, storey) for storey in storeys))
            mean = sum(drawing) / max(1, len(drawing))
            masked = source.photographed is not None
            yield ScanCounts(graph.scan, len(graph.viewpoints), len(drawn), todo, plans, mean, masked)


def export_scan(
    project: Project,
    root: Path,
    scan: str | None = None,
    settings: ScanSettings | None = None,
    with_stub: bool = True,
    force: bool = False,
    backend: Backend = "auto",
    most: int | None = None,
    listen: Listener = ignore_event,
    executor: Executor | None = None,
) -> list[ScanPlaces]:
    """Writes the graph and the models of `project` as a scan into the folder `root`, which may hold other scans.

    The scan is named `scan`, or after the project. Finished files are not written again. A graph of more than `most`
    viewpoints is written in parts, with a table of them. Returns the file locations of each scan.

    The images are drawn by `executor`, or in this process if it is None. This process writes them in both cases.

    Raises InputError if a model or the graph is missing, the graph would fail in agents (unless `force`), the folder
    contains files that NVSim did not write, or writing fails.
    """
    settings = settings or ScanSettings()
    prepared = PreparedExport.of(project, root, scan, force, most)
    graph, parts, places = prepared.graph, prepared.parts, prepared.places
    estimated = prepared.estimate(settings, with_stub, backend)
    listen(Log(estimated.sentence, STAGE))
    if short := prepared.shortage(estimated):
        listen(Warning(short, STAGE))
    for part, scan_places in zip(parts, places, strict=True):
        write_scan(prepared.source, part, scan_places, settings, backend, listen, executor)
    if len(parts) > 1:
        write_parts(root / f"{graph.scan}-parts.csv", parts)
        cut = len(graph.edges) - sum(len(part.edges) for part in parts)
        listen(Log(f"{len(parts)} parts; {cut} edges between them are in no part.", STAGE))
    if with_stub:
        stub.write_stub(places[0], settings.views)
        listen(Log(stub.WHY, STAGE))
    for part, scan_places in zip(parts, places, strict=True):
        results = {"scan": part.scan, "viewpoints": len(part.viewpoints), "written": str(scan_places.folder)}
        listen(Done(STAGE, f"{len(part.viewpoints)} viewpoints as scan {part.scan} in {root}", results))
    return list(places)


def write_scan(
    source: ScanModels,
    graph: NavGraph,
    places: ScanPlaces,
    settings: ScanSettings,
    backend: Backend,
    listen: Listener,
    executor: Executor | None = None,
) -> None:
    """Writes one scan, its manifest last. Raises InputError in the cases that `export_scan` lists."""
    atomic.make_folder(places.folder)
    with _locked(places):
        record = ScanRecord(places)
        remove_leftovers(places)
        viewpoints = drawn_of(graph)
        draw_viewpoints(source, viewpoints, places, settings, record, backend, listen, executor)
        if settings.plans:
            _add_plans(source, graph, places, record)
        if source.photographed is not None:
            _add_unseen(source, graph, places, record, settings.size)
        _add_connectivity(graph, places, record)
        about = {
            "made_by": f"nvsim {__version__}",
            "scan": graph.scan,
            "viewpoints": len(graph.viewpoints),
            "edges": len(graph.edges),
            "settings": asdict(settings),
            "backend": resolve_backend(backend),
            **_ABOUT,
        }
        own = [name for name, has in ((PLANS, settings.plans), (UNSEEN, source.photographed is not None)) if has]
        record.close(about, [GRAPH, *own, *viewpoints])


@contextmanager
def _locked(places: ScanPlaces) -> Iterator[None]:
    lock = WriterLock(places.lock)
    try:
        yield
    finally:
        places.lock.unlink(missing_ok=True)
        lock.release()


def _add_plans(source: ScanModels, graph: NavGraph, places: ScanPlaces, record: ScanRecord) -> None:
    viewpoints = [[v.id, v.position, v.height, v.included] for v in graph.viewpoints.values()]
    key = key_of(MADE, dict(source.keys), graph.scan, viewpoints, list(graph.edges))
    if not record.finished(PLANS, key):
        files = write_plans(source.scene, graph, source.submaps, places.plans)
        record.add(PLANS, part_on_disk(places.root, files, key))


def _add_unseen(source: ScanModels, graph: NavGraph, places: ScanPlaces, record: ScanRecord, side: int) -> None:
    drawn = [[v.id, v.position] for v in graph.viewpoints.values() if v.included]
    key = key_of(MADE, dict(source.keys), drawn, side)
    if not record.finished(UNSEEN, key):
        record.add(UNSEEN, part_on_disk(places.root, write_unseen(source, graph, places, side), key))


def _add_connectivity(graph: NavGraph, places: ScanPlaces, record: ScanRecord) -> None:
    drawn = [v for v in graph.viewpoints.values() if v.included]
    rows = {v.id: i for i, v in enumerate(drawn)}
    sees = np.stack([visible_from(places, v, drawn) for v in drawn]) if drawn else np.zeros((0, 0), np.bool_)

    def visible(a: Viewpoint, b: Viewpoint) -> bool:
        return a.included and b.included and bool(sees[rows[a.id], rows[b.id]])

    path = write_connectivity(graph, places.graphs, visible)
    record.parts[GRAPH] = part_on_disk(places.root, [path], "")
