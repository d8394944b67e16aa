"""A checked export of a scan with its file locations and its estimate. Writes nothing."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error
from nvsim.graph.connectivity import check_scan_id
from nvsim.graph.exports import refuse
from nvsim.graph.types import NavGraph
from nvsim.project.project import Project
from nvsim.project.stages.mapped import scan_name
from nvsim.r2r.observations import stub
from nvsim.r2r.observations.drawing import drawn_of, missing
from nvsim.r2r.observations.estimate import Counts, Estimate, estimate, shortage
from nvsim.r2r.observations.overwrite_guard import refuse_foreign
from nvsim.r2r.observations.parts import split
from nvsim.r2r.observations.places import ScanPlaces
from nvsim.r2r.observations.plan_files import frame_of, storeys_with
from nvsim.r2r.observations.record import Record
from nvsim.r2r.observations.settings import ScanSettings
from nvsim.r2r.observations.source import Source
from nvsim.render.backends import Backend, chosen
from nvsim.splats.files import count_of


@dataclass(frozen=True, eq=False)
class Prepared:
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
    source: Source

    @staticmethod
    def of(
        project: Project, root: Path, scan: str | None = None, force: bool = False, most: int | None = None
    ) -> Prepared:
        """Checks an export.

        Raises InputError if a model or the graph is missing, the graph would fail in agents (unless `force`), or the
        folder is not writable or contains files that NVSim did not write.
        """
        graph = replace(project.need_graph(), scan=scan or scan_name(project))
        check_scan_id(graph.scan)
        if graph.scan == stub.SCAN:
            raise InputError(f"{stub.SCAN} is the name of the stub scan that agents need; choose another --scan.")
        if not force:
            refuse(graph)
        parts = (graph,) if most is None else tuple(split(graph, most))
        places = tuple(ScanPlaces(root, part.scan) for part in parts)
        for scan_places in places:
            refuse_foreign(scan_places)
        _refuse_unwritable(root)
        return Prepared(root, graph, parts, places, Source.of(project, graph))

    def estimate(self, settings: ScanSettings, with_stub: bool, backend: Backend) -> Estimate:
        """Estimates sizes and duration.

        Raises InputError if the backend is not available, or an existing manifest or a model description is damaged.
        """
        import numba

        beside = stub.SCAN if with_stub and stub.is_wanted(self.places[0]) else ""
        on_card, cores = chosen(backend) == "gsplat", numba.get_num_threads()
        return estimate(tuple(self._counts(settings, backend)), settings, cores=cores, on_card=on_card, stub=beside)

    @property
    def free(self) -> int:
        """Free bytes on the disk of the folder. Raises InputError if they cannot be determined."""
        try:
            return shutil.disk_usage(_there(self.root)).free
        except OSError as error:
            raise as_input_error(self.root, error) from error

    def shortage(self, estimate: Estimate) -> str:
        """Returns a warning if the disk is too small for the export, else ""."""
        return shortage(estimate.missing, self.free, self.root)

    def _counts(self, settings: ScanSettings, backend: Backend) -> Iterator[Counts]:
        source = self.source
        gaussians = {i: count_of(folder) for i, folder in source.folders.items()}
        for graph, places in zip(self.parts, self.places, strict=True):
            drawn = drawn_of(graph)
            record = Record(places, only_look=True)
            todo = len(drawn)
            if record.parts:  # otherwise all viewpoints are missing, and hashing the models is not needed
                todo = sum(1 for _ in missing(source, drawn, settings, record, backend))
            drawing = [gaussians[source.scene.nearest(np.array(v.position))] for v in drawn.values()]
            storeys = storeys_with(graph, source.submaps) if settings.plans else ()
            plans = tuple((frame.width, frame.height) for frame in (frame_of(graph, storey) for storey in storeys))
            mean = sum(drawing) / max(1, len(drawing))
            yield Counts(graph.scan, len(graph.viewpoints), len(drawn), todo, plans, mean)


def _there(root: Path) -> Path:
    """Returns the folder itself, or its nearest parent that exists."""
    place = root.absolute()
    while not os.path.lexists(place) and place != place.parent:
        place = place.parent
    return place


def _refuse_unwritable(root: Path) -> None:
    place = _there(root)
    why = errno.ENOTDIR if not place.is_dir() else 0 if os.access(place, os.W_OK | os.X_OK) else errno.EACCES
    if why:
        raise as_input_error(root, OSError(why, os.strerror(why)))
