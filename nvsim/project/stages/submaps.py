"""Cuts the trajectory into submaps. Commits the frames of each submap, and writes an image."""

from __future__ import annotations

import time
from functools import partial

import numpy as np

from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress, Warning, ignore_event
from nvsim.project import ledger
from nvsim.project.earlier_results import report_replaced_result
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_key
from nvsim.project.state.cuts import write_rows
from nvsim.project.work import StageName
from nvsim.submaps.split import Submap, SubmapConfig, split, storeys_of

STAGE: StageName = "submaps"


def run(project: Project, config: SubmapConfig, listen: Listener = ignore_event) -> tuple[Submap, ...]:
    """Cuts the capture into submaps by `config` and returns them. Does nothing if they are current."""
    from nvsim.submaps.picture import draw_submaps

    key = ledger.key_of(STAGE, capture_key(project), config)
    if ledger.is_current(project, STAGE, key):
        listen(Log("The submaps are up to date.", STAGE))
        return project.need_submaps()
    started = time.monotonic()
    listen(Progress(STAGE, 0, 1))
    ledger.begin_part(project, STAGE, key)
    positions = project.need_capture().positions
    submaps = split(positions, config)
    parts = len(np.unique(storeys_of(positions).part))
    if len(submaps) < parts:
        text = f"The trajectory has {parts} storeys and stairs; fewer submaps mix their floors, so do not set a count."
        listen(Warning(text, STAGE))
    report_replaced_result(project, STAGE, listen)
    cut = project.store_cut(submaps)
    summary = {"submaps": len(submaps), "frames": [len(s.frames) for s in submaps]}
    seconds = time.monotonic() - started
    write = partial(write_rows, submaps=submaps)
    ledger.finish(project, STAGE, seconds, summary, files={"cut/submaps": cut}, write_rows=write)
    draw_submaps(positions, submaps, project.layout.pictures / "submaps.png")
    listen(Progress(STAGE, 1, 1))
    count = "1 submap" if len(submaps) == 1 else f"{len(submaps)} submaps"
    listen(Done(STAGE, f"{count} of {', '.join(str(len(s.frames)) for s in submaps)} frames", summary))
    return submaps


def submaps_of_capture(project: Project) -> tuple[Submap, ...]:
    """The newest cut, for a stage that reads its frames. Raises InputError if there is none, or if it was made from
    another capture than the present one."""
    submaps = project.need_submaps()
    if not project.has_cut_of_capture():
        raise InputError(
            f"{project.layout.root} has another capture than the one that was cut into submaps; run "
            "`nvsim submaps --project` first."
        )
    return submaps


def submaps_key(project: Project) -> str:
    """The key of the committed submaps. Raises InputError if there are none."""
    project.need_submaps()
    found = ledger.record(project, STAGE)
    return "" if found is None else found.key
