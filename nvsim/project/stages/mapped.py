"""Map: the breadth-first walk over the ensemble. Commits the navigation graph with its evidence."""

from __future__ import annotations

import time
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import SCALE_ASSUMED, SCALE_IN_HEIGHTS
from nvsim.capture.types import Capture
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Warning
from nvsim.files.atomic import write_bytes
from nvsim.graph.connectivity import check_scan_id
from nvsim.graph.store import decode_graph, encode_graph
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.project import graph_table, ledger
from nvsim.project.corrections import corrections_key
from nvsim.project.floor_heights import floor_of
from nvsim.project.graph_files import graph_in_file
from nvsim.project.normals_used import KEY, check_normals, last_network, network_of, of_this_network
from nvsim.project.project import Project
from nvsim.project.replaced import listen_to_what_is_replaced
from nvsim.project.scene_views import SceneViews
from nvsim.project.stages.floors import refresh_support, supporting_frames
from nvsim.project.thresholds import recorded
from nvsim.project.work import StageName, lacks
from nvsim.render.backends import Backend

STAGE: StageName = "map"
_FAR = 10.0  # metres
_ALONE = 2  # raised when the same models and floor give another graph where images alone tell what stands
_DRAWN = "wide Gaussians by rays"  # how the views are drawn; changed when the same models give something else


def run(
    project: Project,
    config: MappingConfig,
    listen: Listener,
    reapply: bool = False,
    memory_budget: int | None = None,
    backend: Backend = "auto",
) -> None:
    """Builds the graph; with `reapply` decides the stored one again and renders only what newly opens. `memory_budget`
    in bytes is for the models in memory, as SceneModel takes it; `backend` draws.

    Raises InputError while no submap is trained, and where a network is asked for that is not installed.
    """
    from nvsim.mapping.builder import build_map

    key = map_key(project, config)
    if ledger.is_current(project, STAGE, key):
        project.layout.partial_map.unlink(missing_ok=True)  # of a map that was begun with other settings
        listen(Log("The navigation graph is up to date.", STAGE))
        return
    check_normals(config)
    capture = project.need_capture()
    if not capture.alignment.scale_known:
        listen(Warning(f"The graph is built in camera heights: {SCALE_ASSUMED}; {SCALE_IN_HEIGHTS}.", STAGE))
    start = start_of(capture, config.start)
    refresh_support(project, listen)
    scene, support = project.scene(memory_budget, colours=False), project.support()
    if scene is None or support is None:
        raise lacks(project.layout.root, "train")
    previous = of_this_network(project.graph() if reapply else None, project, config)
    if reapply and previous is None:
        raise InputError(f"{project.layout.root} has no graph to decide again; run `nvsim map --project` first.")
    started = time.monotonic()
    listen_to_what_is_replaced(project, STAGE, listen)
    partial = project.layout.partial_map
    if not ledger.begin(project, STAGE, key):
        partial.unlink(missing_ok=True)
    # What a build that was cut off had measured, or the last one: the graph does not show it all.
    remembered = _evidence(partial)
    if remembered is None and reapply:
        remembered = of_this_network(_evidence(project.layout.measured_map), project, config)
    scan = scan_name(project)
    result = build_map(
        SceneViews(scene, config, backend),
        capture.positions,
        floor_of(project).height_at,
        support.at,
        config,
        scan=scan,
        start=start,
        previous=previous,
        remembered=remembered,
        scanned=capture.is_scanned,
        listen=listen,
        keep=lambda evidence: write_bytes(partial, encode_graph(evidence)),
    )
    seconds, summary = time.monotonic() - started, {**result.report, **recorded(config)}
    # What is not asked now may be asked again: the evidence goes on holding it.
    if network := network_of(config) or (last_network(project) if reapply else ""):
        summary[KEY] = network
    before = graph_in_file(project)
    ledger.finish(project, STAGE, seconds, summary, values=before, write=lambda c: graph_table.write(c, result.graph))
    write_bytes(project.layout.measured_map, encode_graph(result.measured))
    partial.unlink(missing_ok=True)
    graph = result.graph
    listen(Done(STAGE, f"{len(graph.viewpoints)} viewpoints and {len(graph.edges)} edges", result.report))


def _evidence(path: Path) -> NavGraph | None:
    """What was measured, None where nothing readable is."""
    try:
        return decode_graph(path.read_bytes())
    except (OSError, InputError):
        return None


def start_of(capture: Capture, start: str) -> NDArray[np.float64] | None:
    """(3,) where a search begins: at the frame of that name, or at X,Y in the height of the nearest camera; None where
    nothing is asked. Raises InputError on anything else."""
    if not start:
        return None
    for frame in capture.frames:
        if start in (frame.name, PurePosixPath(frame.name).stem):
            return frame.camera_to_world[:3, 3]
    try:
        x, y = (float(part) for part in start.split(","))
    except ValueError as error:
        first = capture.frames[0].name
        raise InputError(f"--start {start} names no frame and is not X,Y in metres; try --start {first}.") from error
    apart = np.hypot(*(capture.positions[:, :2] - (x, y)).T)
    if not np.isfinite(apart).all() or apart.min() > _FAR:
        raise InputError(f"--start {start} is more than {_FAR:.0f} m from every camera; choose a place on the walk.")
    return np.array([x, y, capture.positions[int(apart.argmin()), 2]])


def map_key(project: Project, config: MappingConfig) -> str:
    """What the graph depends on: every trained submap, the floor that corrected masks support, the thresholds, and the
    network that is asked."""
    project.need_submaps()
    trained = [ledger.record(project, "train", s.index) for s in project.submaps("train")]
    corrected = corrections_key(project, supporting_frames(project))
    asked = [_DRAWN, *(["second opinion"] if config.second_opinion and len(trained) > 1 else [])]
    if not project.need_capture().is_scanned:
        asked.append(f"images alone {_ALONE}, around {config.around}")
    network = [found] if (found := network_of(config)) else []
    return ledger.key_of(STAGE, [t.key if t else "" for t in trained], config.key, *asked, *network, *corrected)


def scan_name(project: Project) -> str:
    """The R2R scan id of the project: its folder's name in letters and digits (agents split keys at underscores).
    Raises InputError where another one is stored that no agent reads."""
    chosen = project.meta("scan_name")
    if chosen:
        check_scan_id(chosen)
        return chosen
    letters = "".join(c for c in project.layout.root.stem if c.isascii() and c.isalnum())
    return letters or "scan"
