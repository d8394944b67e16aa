"""Floors: the floor surface of every submap, a mask for every frame, and the floor that they support together."""

from __future__ import annotations

import shutil
import time

import numpy as np

from nvsim.atomic import replacing
from nvsim.events import Done, Listener, Log, Progress
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig, held_out
from nvsim.project.floor_heights import floor_of
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_config
from nvsim.project.stages.submaps import submaps_key

STAGE = "floors"
_VERSION = 3  # of what this stage commits; raised when the same inputs give something else


def run(project: Project, listen: Listener) -> None:
    """Masks of all frames; frames that are held out of training do not count as support."""
    config = capture_config(project)
    key = ledger.key_of(STAGE, submaps_key(project), config, _VERSION)
    if ledger.is_current(project, STAGE, key):
        listen(Log("The floor masks are up to date.", STAGE))
        return
    from nvsim.perception.segment import segment_capture

    layout = project.layout
    resumed = ledger.begin(project, STAGE, key)
    if not resumed:
        shutil.rmtree(layout.masks, ignore_errors=True)
        shutil.rmtree(layout.floor, ignore_errors=True)
    started = time.monotonic()
    listen(Progress(STAGE, 0, 1, "floor heights"))
    capture, submaps = project.need_capture(), project.need_submaps()
    surface_of: dict[int, FloorSurface] = {}
    for submap in submaps:
        surface = _surface(project, submap.index, capture.positions[list(submap.frames)], config)
        for frame in submap.core:
            surface_of[frame] = surface
    segment_capture(capture, surface_of.__getitem__, layout.masks, listen=listen)
    coverage = _support(project, config)
    summary = {"frames": len(capture.frames), "supported_m2": round(coverage, 1)}
    ledger.finish(project, STAGE, time.monotonic() - started, summary)
    listen(Done(STAGE, f"floor masks of {len(capture.frames)} frames, {coverage:.0f} m² of supported floor", summary))


def _surface(project: Project, submap: int, positions: np.ndarray, config: CaptureConfig) -> FloorSurface:
    from nvsim.perception.floor_height import estimate_floor

    found = project.surface(submap)
    if found is not None:
        return found
    surface = estimate_floor(project.need_capture().cloud, positions, config.camera_height)
    with replacing(project.layout.surface(submap)) as path:
        np.savez(path, heights=surface.heights, origin=np.array(surface.origin), spacing=surface.spacing)
    return surface


def _support(project: Project, config: CaptureConfig) -> float:
    """Commits the supported floor; returns its area in square metres."""
    from nvsim.perception.segment import read_mask
    from nvsim.perception.support import observe

    capture = project.need_capture()
    kept_out = held_out(len(capture.frames), config.hold_out)
    frames = [i for i in range(len(capture.frames)) if i not in kept_out]
    support = observe(
        [capture.frames[i].camera for i in frames],
        (read_mask(project.layout.mask(i)) for i in frames),
        floor_of(project),
        capture.cloud,
    ).trodden(capture.positions[frames])
    support.save(project.layout.support)
    return float(support.cells.sum() * support.spacing**2)


def floors_key(project: Project) -> str:
    """The key of the committed masks, "" while there are none."""
    found = ledger.record(project, STAGE)
    return found.key if found is not None and found.state == "done" else ""
