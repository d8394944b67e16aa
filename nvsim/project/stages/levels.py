"""Finds the floor of a project from splat files: the floor heights of its storeys, and the known floor of each."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nvsim.events import Done, Listener, Log, Progress, ignore_event
from nvsim.files.atomic import make_folder
from nvsim.files.stored_arrays import write_arrays
from nvsim.project import ledger
from nvsim.project.earlier_results import report_replaced_result
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_key
from nvsim.project.stages.imported_splats import imported_storeys
from nvsim.project.work import StageName, missing_result_error

if TYPE_CHECKING:
    from nvsim.geometry.floor_surface import FloorSurface

STAGE: StageName = "floors"
_VERSION = "splats 2"  # changed when equal models give another result


def run(project: Project, listen: Listener = ignore_event) -> None:
    """Commits the floor surface of each storey and the known floor. Raises InputError if the models are missing."""
    from nvsim.geometry.floor_surface import StackedFloor
    from nvsim.perception.stacked_support import StackedSupport
    from nvsim.perception.support import FloorSupport
    from nvsim.project.floor_heights import floor_of
    from nvsim.scene_import.levels import ceiling_distances, known_floor

    key = levels_key(project)
    if ledger.is_current(project, STAGE, key):
        listen(Log("The floor is up to date.", STAGE))
        return
    started, scene = time.monotonic(), project.scene(colors=False)
    if scene is None:
        raise missing_result_error(project.layout.root, "import")
    report_replaced_result(project, STAGE, listen)
    ledger.begin_part(project, STAGE, key)
    found = project.stage_results()
    newest = found.places.get("cut/submaps")
    project = project.making({**found.made_at(STAGE), **({"cut/floors": newest} if newest else {})})
    make_folder(project.layout.floor)
    heights, parts = imported_storeys(project)
    tops, submaps = ceiling_distances(heights), project.need_submaps()
    known: list[FloorSupport] = []
    for submap, storeys in zip(submaps, parts, strict=True):
        listen(Progress(STAGE, submap.index, len(submaps), f"storey {storeys[0] + 1}"))
        model = scene.model(submap.index)
        _save_surface(project.layout.surface(submap.index), model.floor)
        if len(storeys) == 1:
            grid, _, cells = known_floor(model.gaussians, model.floor, heights[storeys[0]], tops[storeys[0]])
            known.append(FloorSupport(cells, grid.low, grid.spacing))
    floor, area = floor_of(project), sum(float(one.cells.sum()) * one.spacing**2 for one in known)
    stacked = isinstance(floor, StackedFloor) and len(floor.storeys) == len(known)
    if not stacked:  # storeys side by side have one floor height at each place
        known = [FloorSupport(np.any([one.cells for one in known], axis=0), known[0].origin, known[0].spacing)]
    for submap, storeys in zip(submaps, parts, strict=True):
        for storey in storeys if len(storeys) > 1 else ():
            own = storey if stacked else 0
            known[own] = known[own].with_trajectory_floor(submap.positions)
    if isinstance(floor, StackedFloor) and stacked:
        StackedSupport(floor, tuple(known)).save(project.layout.support)
    else:
        known[0].save(project.layout.support)
    summary = {"storeys": len(heights), "supported_m2": round(area, 1)}
    ledger.finish(project, STAGE, time.monotonic() - started, summary)
    listen(Progress(STAGE, len(submaps), len(submaps)))
    count = f"{len(heights)} storey" if len(heights) == 1 else f"{len(heights)} storeys"
    listen(Done(STAGE, f"{area:.0f} m² of known floor on {count}", summary))


def levels_key(project: Project) -> str:
    """The key of the floor: the imported splats without the removed Gaussians."""
    return ledger.key_of(STAGE, capture_key(project), _VERSION, *ledger.removal_key(project))


def _save_surface(path: Path, surface: FloorSurface) -> None:
    origin, spacing = np.array(surface.origin), np.array(surface.spacing)
    write_arrays(path, {"heights": surface.heights, "origin": origin, "spacing": spacing})
