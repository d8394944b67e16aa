"""Imports splat files as a project without images: aligns them, finds their storeys, and commits one model per
storey."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.capture.types import Alignment, Capture
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress, Warning, ignore_event
from nvsim.files.opening import opened, size_of
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig
from nvsim.project.earlier_results import report_replaced_result
from nvsim.project.layout import model_name
from nvsim.project.project import Project
from nvsim.project.work import StageName, missing_result_error
from nvsim.submaps.split import Submap

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from nvsim.scene_import.levels import Level
    from nvsim.splats.types import Gaussians

STAGE: StageName = "import"
FORMAT = "splats"
CAMERA_HEIGHT = 1.5
"""Meters of the viewpoints above the floor, if the user gives no height."""
_HEIGHTS = (0.2, 2.0)
_VERSION = 2  # increased when equal files give another result


def is_splats(source: Path) -> bool:
    """Whether the path is that of a splat file."""
    from nvsim.splats.formats.choice import named_as_splats

    return named_as_splats(source) and source.expanduser().is_file()


def run(project: Project, source: Path, config: CaptureConfig, listen: Listener = ignore_event) -> Capture:
    """Imports the splat file, or the list of splat files, `source`. Raises InputError if it is damaged, does not show
    the inside of a building, or if an option does not apply to splat files."""
    from nvsim.capture.store import save_capture
    from nvsim.scene_import.parts import divide
    from nvsim.scene_import.scene import align_scene
    from nvsim.splats.files import save_model, store_removed
    from nvsim.splats.formats.choice import read_splats, source_up_axis
    from nvsim.splats.types import SubmapModel, select_gaussians

    started, source = time.monotonic(), source.expanduser().absolute()
    _refuse_options(config)
    height = CAMERA_HEIGHT if config.camera_height is None else config.camera_height
    if not _HEIGHTS[0] <= height <= _HEIGHTS[1]:
        low, high = _HEIGHTS
        raise InputError(
            f"--camera-height {height:g} is the height of the viewpoints of a splat file and must be {low} to {high} m."
        )
    key = ledger.key_of(STAGE, FORMAT, _VERSION, _fingerprint(source), str(source), config.key)
    stored = project.capture() if ledger.is_current(project, STAGE, key) else None
    if stored is not None:
        listen(Log("The capture is unchanged.", STAGE))
        return stored
    listen(Progress(STAGE, 0, 3, str(source)))
    splats = read_splats(source)
    listen(Progress(STAGE, 1, 3, "storeys"))
    scene = align_scene(str(source), splats.gaussians, source_up_axis(source), config.up, config.scale)
    for note in (*splats.notes, *scene.notes):
        listen(Log(note, STAGE))
    for doubt in scene.doubts:
        listen(Warning(doubt, STAGE))
    gaussians, levels = scene.gaussians, scene.storeys.levels
    removed = _found_for_removal(gaussians, levels, height, listen) if config.clean else None
    listen(Progress(STAGE, 2, 3, "models"))
    parts, places = divide(gaussians, scene.surface, scene.storeys, height)
    submaps = tuple(Submap(i, part.rows, part.rows, places[list(part.rows)]) for i, part in enumerate(parts))
    alignment = Alignment(scene.rotation, scene.scale, scene.scale_known)
    capture = Capture(source, FORMAT, (), None, alignment, places=places)
    report_replaced_result(project, STAGE, listen)
    project.fix_cut()
    ledger.begin_part(project, STAGE, key)
    folder = project.making(project.stage_results().made_at(STAGE)).layout.imported
    antialiased = False if splats.antialiased is None else splats.antialiased
    for index, part in enumerate(parts):
        own = select_gaussians(gaussians, part.members)
        save_model(
            SubmapModel(own, None, None, part.surface, antialiased, {"source": source.name}),
            folder / model_name(index),
        )
        if removed is not None:
            store_removed(folder / model_name(index), removed[part.members])
    save_capture(capture, folder)
    project.set_submaps(submaps)  # before the import is finished, so that a killed import is repeated
    heights = [round(level.height, 4) for level in levels]
    summary = {"gaussians": len(gaussians), "floors": heights, "parts": [part.storeys for part in parts]}

    ledger.finish(project, STAGE, time.monotonic() - started, summary, settings=json.dumps(asdict(config)))
    listen(Progress(STAGE, 3, 3))
    at = " and ".join(f"{h:.2f}" for h in heights)
    stairs = len(parts) - len(levels)
    words = f"{len(gaussians)} Gaussians, {'floor' if len(levels) == 1 else 'floors'} at {at} m"
    words += f", {stairs} {'stair' if stairs == 1 else 'stairs'}" if len(levels) > 1 else ""
    listen(Done(STAGE, f"{words} from a splat file", summary))
    return capture


def imported_storeys(project: Project) -> tuple[list[float], list[tuple[int, ...]]]:
    """World z of the floor of each storey in meters, ascending; and for each submap its storey, or the two storeys that
    its stair joins. Raises InputError if nothing is imported."""
    found = ledger.record(project, STAGE)
    if found is None or "parts" not in found.summary:
        raise missing_result_error(project.layout.root, STAGE)
    return list(map(float, found.summary["floors"])), [tuple(map(int, part)) for part in found.summary["parts"]]


def _refuse_options(config: CaptureConfig) -> None:
    """Raises InputError if an option needs images."""
    usual = CaptureConfig()
    for name in ("known_length", "leave_out", "images", "axes", "model", "poses", "views", "mask"):
        if getattr(config, name) != getattr(usual, name):
            raise InputError(f"--{name.replace('_', '-')} needs images, and a splat file has none; leave it out.")


def _fingerprint(source: Path) -> tuple[int, ...]:
    """Size and time of the file, and of those that it names if it is a list. Raises InputError if one cannot be
    read."""
    from nvsim.splats.formats.choice import files_of

    found: list[int] = []
    for path in files_of(source):
        with opened(path) as file:
            found += size_of(file), path.stat().st_mtime_ns
    return tuple(found)


def _found_for_removal(
    gaussians: Gaussians, levels: tuple[Level, ...], height: float, listen: Listener
) -> NDArray[np.bool_]:
    """(N,) bool, the floaters, the fog, and the Gaussians outside the building."""
    from nvsim.scene_import.cleaning import find_candidates

    found = find_candidates(gaussians, levels, height)
    removed = found["floater"] | found["outside"]
    text = (
        f"{int(removed.sum())} of {len(gaussians)} Gaussians are removed: {int(found['floater'].sum())} floaters that "
        f"views see through, and {int(found['outside'].sum())} outside the building. `nvsim splat clean` restores them."
    )
    listen(Log(text, STAGE))
    return removed
