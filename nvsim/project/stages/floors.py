"""Finds the floor: a surface for each submap, a mask for each frame, and the floor that the masks support together.
Thin obstacles above the floor that estimated depth misses are found with the masks."""

from __future__ import annotations

import contextlib
import shutil
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.capture.masks import usable_pixels, usable_pixels_of_frames
from nvsim.cluster.piece import Executor
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress, Warning, ignore_event
from nvsim.files.frame_numbers import write_frame_names
from nvsim.files.stored_arrays import read_arrays, write_arrays
from nvsim.geometry.floor_surface import FloorSurface, StackedFloor
from nvsim.perception.roles import FAILURE_WORDS
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig, FloorsConfig, held_out
from nvsim.project.corrections import corrected_frames, corrections_key, discard_corrections
from nvsim.project.earlier_results import report_replaced_result
from nvsim.project.floor_heights import floor_of, floors_seen
from nvsim.project.floor_provider import choose
from nvsim.project.project import Project
from nvsim.project.stages import levels
from nvsim.project.stages.depths import depth_maps
from nvsim.project.stages.imported import capture_config
from nvsim.project.stages.submaps import submaps_key, submaps_of_capture
from nvsim.project.work import StageName
from nvsim.submaps.split import Submap, TrajectoryStoreys, storeys_of

if TYPE_CHECKING:
    from nvsim.capture.types import Cloud
    from nvsim.geometry.camera import Camera
    from nvsim.perception.support import FloorSupport


_THREADS = 2


def floor_surfaces(project: Project, submaps: tuple[Submap, ...], config: CaptureConfig) -> dict[int, FloorSurface]:
    """Submap index -> floor surface. Existing surfaces are reused.

    If storeys overlap, a submap has the floor of its storey. Stairs are estimated last, because their camera height is
    taken from the storeys.
    """
    positions = project.need_capture().positions
    storeys = storeys_of(positions)
    found: dict[int, FloorSurface] = {}
    for submap in sorted(submaps, key=lambda s: _part(s, storeys) % 2):
        with contextlib.suppress(InputError):  # a damaged surface is estimated again
            known = project.surface(submap.index)
            if known is not None:
                found[submap.index] = known
                continue
        surface = _estimate_surface(project, submap, storeys, config, found, submaps)
        arrays = {
            "heights": surface.heights,
            "origin": np.array(surface.origin),
            "spacing": np.array(surface.spacing),
        }
        write_arrays(project.layout.surface(submap.index), arrays, compressed=False)
        found[submap.index] = surface
    return found


def _part(submap: Submap, storeys: TrajectoryStoreys) -> int:
    """The storey or stair of most frames in a submap's core, as numbered in `TrajectoryStoreys.part`."""
    return int(np.bincount(storeys.part[list(submap.core)]).argmax())


def _estimate_surface(
    project: Project,
    submap: Submap,
    storeys: TrajectoryStoreys,
    config: CaptureConfig,
    found: dict[int, FloorSurface],
    submaps: tuple[Submap, ...],
) -> FloorSurface:
    from nvsim.perception.floor_height import estimate_floor, stair_floor

    positions, frames, part = project.need_capture().positions, list(submap.frames), _part(submap, storeys)
    if len(storeys.levels) == 1:
        return estimate_floor(project.scan(), positions[frames], config.camera_height)
    if part % 2 and found:
        return stair_floor(positions[frames], _median_camera_height(positions, storeys, found, submaps))
    # Frames of neighbors on a stair would bend the floor of the room beside it.
    level = [i for i in frames if storeys.part[i] == part]
    return estimate_floor(project.scan(), positions[level], config.camera_height, above_another=part > 0)


def _median_camera_height(
    positions: NDArray[np.float64],
    storeys: TrajectoryStoreys,
    found: dict[int, FloorSurface],
    submaps: tuple[Submap, ...],
) -> float:
    """Median height in meters of the cameras over the known floors."""
    heights = [
        positions[i, 2] - float(found[s.index].height_at(positions[i, :2]))
        for s in submaps
        if s.index in found
        for i in s.core
        if storeys.part[i] % 2 == 0
    ]
    return float(np.median(heights))


STAGE: StageName = "floors"
_SUPPORT = 1  # the part of the stage that depends on corrections
_VERSION = 4  # of the committed data; increased when equal inputs give another result
_WITH_DEPTH = 6  # version for captures with estimated depth or depth images
_WITH_STAIRS = "stairs 3"  # version for captures with overlapping storeys
_WITH_SUBMAPS = "submaps 2"  # version for captures with several submaps

_NOTHING_STANDS = (
    "The project has no LiDAR scan and no depth, so obstacles on the floor are hard to detect. Masks and map may lead "
    "through furniture; run `nvsim depth --project` first."
)


def run(
    project: Project,
    listen: Listener = ignore_event,
    discard: bool = False,
    config: FloorsConfig | None = None,
    executor: Executor | None = None,
) -> None:
    """Computes the masks of all frames and the supported floor. Held-out frames do not count as support.

    discard  remove the corrections of users; otherwise they stay and replace NVSim's masks

    If `executor` is a cluster whose machines can read the images, they share the work. Raises InputError if a network
    is selected and not installed, or cannot be used.
    """
    if not project.need_capture().has_images:
        levels.run(project, listen)
        return
    config = config or FloorsConfig()
    how = capture_config(project)
    provider = choose(config, project.scan)
    if discard:
        listen(Log(f"Discarded the corrections of {discard_corrections(project)} floor masks.", STAGE))
    depth = project.stage_results().depth
    # Keys without depth, stairs, or submaps have the form of versions without these features, so that old results stay
    # current.
    stacked = len(storeys_of(project.need_capture().positions).levels) > 1
    parts = [*([depth.key, _WITH_DEPTH] if depth else []), *([_WITH_STAIRS] if stacked else [])]
    parts += [*([_WITH_SUBMAPS] if len(project.submaps()) > 1 else []), *provider.key()]
    key = ledger.key_of(STAGE, submaps_key(project), how.key, _VERSION, *parts)
    if ledger.is_current(project, STAGE, key) and _is_whole(project):
        listen(Log(f"The floor masks are up to date; they were made {provider.description}.", STAGE))
        refresh_support(project, listen)
        return
    from nvsim.perception.segment import segment_capture

    listen(Log(f"The floor is found {provider.description}.", STAGE))
    capture, submaps = replace(project.need_capture(), cloud=project.scan()), submaps_of_capture(project)
    other = provider.open(capture, listen)  # raises before any result is replaced
    if capture.cloud is None or not capture.cloud.is_dense:
        listen(Warning(_NOTHING_STANDS, STAGE))
    report_replaced_result(project, STAGE, listen)
    resumed = ledger.begin_part(project, STAGE, key)
    # New results are made beside those in use, for the newest cut.
    found = project.stage_results()
    newest = found.places.get("cut/submaps")
    making = {**found.made_at(STAGE), **({"cut/floors": newest} if newest else {})}
    project = project.making(making)
    layout = project.layout
    if not resumed:
        shutil.rmtree(layout.masks, ignore_errors=True)
        shutil.rmtree(layout.floor, ignore_errors=True)
    started = time.monotonic()
    listen(Progress(STAGE, 0, 1, "floor heights"))
    floor_surfaces(project, submaps, how)
    if executor is not None and executor.remote:
        from nvsim.project.stages.floors_remote import segment_remote

        segment_remote(executor, project, making, config, provider.key(), listen)
    seen = depth_maps(project)
    floors = floors_seen(project)
    if seen is not None and not stacked:  # on several storeys, the floor of each obstacle would be ambiguous
        find_thin_obstacles(project, floors, listen, STAGE)
    failures = segment_capture(capture, floors.__getitem__, layout.masks, listen=listen, depth_of=seen, other_of=other)
    support_key = _support_key(project, key)
    coverage = _support(project)
    counts = {word: sum(f == word for f in failures.values()) for word in FAILURE_WORDS}
    summary = {
        "frames": len(capture.frames), "supported_m2": round(coverage, 1), **provider.summary,
        **({"failures": {word: n for word, n in counts.items() if n}} if failures else {}),
    }  # fmt: skip
    write_frame_names(layout.masks, [frame.name for frame in capture.frames])
    ledger.finish(project, STAGE, time.monotonic() - started, summary, also={_SUPPORT: support_key})
    corrected = len(corrected_frames(layout, capture.frames))
    words = f"floor masks of {len(capture.frames)} frames" + (f", {corrected} of them corrected" if corrected else "")
    for word, count in counts.items():
        if count:
            listen(Warning(f"In {count} of {len(capture.frames)} frames {FAILURE_WORDS[word]}.", STAGE))
    if failures:
        listen(Log('The frame list of the window shows them with the filter "Doubtful masks".', STAGE))
    listen(Done(STAGE, f"{words}, {coverage:.0f} m² of supported floor", summary))


def refresh_support(project: Project, listen: Listener) -> None:
    """Computes the supported floor again if masks have been corrected. Raises InputError if files are damaged."""
    masks_key, found = floors_key(project), ledger.record(project, STAGE, _SUPPORT)
    if not masks_key:
        return
    key = _support_key(project, masks_key)
    # Projects from versions without corrections have no separate row for the support.
    made_with = masks_key if found is None else found.key
    if made_with == key:
        return
    started = time.monotonic()
    ledger.begin_part(project, STAGE, key, _SUPPORT)
    coverage = _support(project)
    ledger.finish(project, STAGE, time.monotonic() - started, {}, _SUPPORT)
    listen(Log(f"With the corrected masks, {coverage:.0f} m² of floor are supported.", STAGE))


def _is_whole(project: Project) -> bool:
    """Whether all committed files exist; a user may have deleted damaged ones."""
    layout = project.layout
    try:
        found = [project.support(), *(project.surface(s.index) for s in project.need_submaps())]
    except InputError:
        return False
    masks = (layout.mask(i).is_file() for i in range(len(project.need_capture().frames)))
    return all(part is not None for part in found) and all(masks)


def supporting_frames(project: Project) -> list[int]:
    """Indices of the frames whose masks count as support: all that are not held out."""
    count = len(project.need_capture().frames)
    kept_out = held_out(count, capture_config(project).hold_out)
    return [i for i in range(count) if i not in kept_out]


def _support_key(project: Project, masks_key: str) -> str:
    """The key of the supported floor. Call it before the masks are read, so that later corrections count as not
    included."""
    corrected = corrections_key(project, supporting_frames(project))
    return ledger.key_of(masks_key, *corrected) if corrected else masks_key


def _support(project: Project) -> float:
    """Commits the supported floor; returns its area in square meters."""
    from nvsim.perception.stacked_support import StackedSupport

    frames, floor = supporting_frames(project), floor_of(project)
    if isinstance(floor, StackedFloor):
        storeys, cloud = storeys_of(project.need_capture().positions), project.scan_on(floor)
        found = StackedSupport(
            floor,
            tuple(
                _find_support(project, [i for i in frames if storeys.cameras_of_storey(k)[i]], surface, cloud)
                for k, surface in enumerate(floor.storeys)
            ),
        )
        found.save(project.layout.support)
        return found.area
    support = _find_support(project, frames, floor, project.scan_on(floor))
    support.save(project.layout.support)
    return float(support.cells.sum() * support.spacing**2)


def _find_support(project: Project, frames: list[int], floor: FloorSurface, cloud: Cloud | None) -> FloorSupport:
    """The floor that the masks of `frames` and the cloud support."""
    from nvsim.perception.segment import SegmentConfig, read_mask
    from nvsim.perception.support import observe, positions_at_common_heights

    capture, masks = project.need_capture(), (read_mask(project.mask_path(i)) for i in frames)
    cameras = [capture.frames[i].camera for i in frames]
    usable = usable_pixels_of_frames((capture.frames[i] for i in frames), SegmentConfig().longest_side)
    found = observe(cameras, masks, floor, cloud, raised=thin_obstacle_places(project), usable=usable)
    return found.with_trajectory_floor(positions_at_common_heights(capture.positions[frames], floor))


def floors_key(project: Project) -> str:
    """The key of the committed masks, "" if there are none."""
    found = ledger.record(project, STAGE)
    return "" if found is None else found.key


def find_thin_obstacles(project: Project, floors: dict[int, FloorSurface], listen: Listener, stage: str) -> None:
    """Writes the places of thin obstacles; an existing file is kept. `floors` has the floor surface around each frame.
    Raises InputError if an image cannot be read."""
    from nvsim.perception.raised_lines import LineConfig, raised_lines, thin_object_places

    path = project.layout.raised
    if path.exists():
        return
    capture, config = project.need_capture(), LineConfig()
    cameras: list[Camera] = []
    heights = np.full(len(capture.frames), np.nan)
    for i, frame in enumerate(capture.frames):
        k = frame.intrinsics.limited_to(config.longest_side)
        cameras.append(frame.camera.scaled(k.width, k.height))
        if i in floors:
            heights[i] = floors[i].height_at(cameras[i].position[:2])
    done = 0

    def progress() -> None:
        nonlocal done
        done += 1
        if done % 10 == 0:
            listen(Progress(stage, 0, len(cameras), f"thin obstacles, {done} of {len(cameras)} frames"))

    lines = raised_lines(
        cameras,
        lambda i: read_image(capture.frames[i], cameras[i].intrinsics),
        heights,
        config,
        _THREADS,
        progress,
        lambda i: usable_pixels(capture.frames[i], cameras[i].intrinsics),
    )
    places = thin_object_places(lines, capture.positions, config)
    write_arrays(path, {"places": places})
    if len(places):
        listen(Log(f"Image edges show thin obstacles above the floor along {len(places) * config.cell:.0f} m.", stage))


def thin_obstacle_places(project: Project) -> NDArray[np.float64] | None:
    """(K, 2) places of thin obstacles, meters, world, from `find_thin_obstacles`; None if there is no file.

    Raises InputError if the file is damaged."""
    path = project.layout.raised
    if not path.exists():
        return None
    return np.asarray(
        read_arrays(path, "thin obstacles", {"places": ("f", 2)}, "run `nvsim floors --project` again")["places"]
    )
