"""Builds the map by a breadth-first search over the trained models. Commits the navigation graph and its evidence."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import SCALE_ASSUMED, SCALE_IN_HEIGHTS
from nvsim.capture.types import Capture
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Warning, ignore_event
from nvsim.files.atomic import write_bytes
from nvsim.files.opening import read_bytes
from nvsim.graph.store import decode_graph, encode_graph
from nvsim.graph.types import Evidence, NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.families import NETWORK_NORMAL
from nvsim.perception.furniture import share_without_points_below, short_walk, uneven_height_range
from nvsim.perception.normals_network import installed_normals, normals_model
from nvsim.plain_text import count_text
from nvsim.project import ledger
from nvsim.project.corrections import corrections_key
from nvsim.project.earlier_results import graph_in_file, report_replaced_result
from nvsim.project.floor_heights import floor_of
from nvsim.project.graph import recorded_config, seen_floor
from nvsim.project.photographed import PhotographedDirections, with_shares
from nvsim.project.project import Project
from nvsim.project.scene_views import SceneViews
from nvsim.project.stages.floors import floors_key, refresh_support, supporting_frames
from nvsim.project.stages.imported import capture_key
from nvsim.project.state import graph_table
from nvsim.project.work import StageName, missing_result_error
from nvsim.render.backends import Backend

if TYPE_CHECKING:
    from nvsim.mapping.explanation.wall_openings import WallGrid

STAGE: StageName = "map"
NETWORK = "network"  # key of the normals network in the summary
_FAR = 10.0  # meters
_MOST = 0.5  # of the viewpoints on the floor; with fewer, the graph stands on furniture
_ALONE = 3  # increased when equal inputs give another graph for captures whose obstacles are only known from images
_DRAWN = "wide Gaussians by rays"  # how views are rendered; changed when equal models give another image


def run(
    project: Project,
    config: MappingConfig,
    listen: Listener = ignore_event,
    reapply: bool = False,
    memory_budget: int | None = None,
    backend: Backend = "auto",
) -> None:
    """Builds the graph. With `reapply`, decides the stored graph again and renders only newly opened places.

    memory_budget  bytes for the models in memory, see SceneModel
    backend        rasterizer of the views

    Raises InputError if no submap is trained, a required network is not installed, or there is no graph to `reapply`.
    """
    from nvsim.mapping.builder import build_map
    from nvsim.mapping.explanation.wall_openings import WallOpenings, write_walls

    capture = project.need_capture()
    if not capture.has_images:
        config = for_splats(config)
    key = map_key(project, config)
    if ledger.is_current(project, STAGE, key):
        project.layout.partial_map.unlink(missing_ok=True)  # of an interrupted build with other options
        listen(Log("The navigation graph is up to date.", STAGE))
        return
    check_normals(config)
    if not capture.alignment.scale_known and capture.has_images:
        listen(Warning(f"The graph is built in units of camera heights: {SCALE_ASSUMED}; {SCALE_IN_HEIGHTS}.", STAGE))
    start = search_start(capture, config.start)
    refresh_support(project, listen)
    scene, support = project.scene(memory_budget, colors=False), project.support()
    if scene is None or support is None:
        raise missing_result_error(project.layout.root, "train")
    previous = without_other_networks(project.graph() if reapply else None, project, config)
    if reapply and previous is None:
        raise InputError(f"{project.layout.root} has no graph to decide again; run `nvsim map --project` first.")
    started = time.monotonic()
    report_replaced_result(project, STAGE, listen)
    unfinished = project.layout.partial_map
    if not ledger.begin_part(project, STAGE, key):
        unfinished.unlink(missing_ok=True)
    # Evidence of an interrupted or previous build, which may include places that the graph does not have.
    remembered = _evidence(unfinished)
    if remembered is None and reapply:
        remembered = without_other_networks(_evidence(project.layout.measured_map), project, config)
    scan = project.scan_name
    walls = _walls(project, capture)
    result = build_map(
        SceneViews(scene, config, backend),
        capture.positions,
        floor_of(project).height_at,
        support.is_supported,
        config,
        scan=scan,
        start=start,
        previous=previous,
        remembered=remembered,
        scanned=not capture.trajectory_counts,
        openings=None if walls is None else WallOpenings(walls, capture.positions),
        seen=seen_floor(project),
        listen=listen,
        keep=lambda evidence: write_bytes(unfinished, encode_graph(evidence)),
    )
    photographed = PhotographedDirections(project, scene, backend)
    graph = with_shares(result.graph, photographed.shares(result.graph, result.graph.viewpoints))
    report = {**result.report, **_photographed_figures(graph, config, listen)}
    seconds, summary = time.monotonic() - started, {**report, **recorded_config(config)}
    # Evidence of a network stays in the graph if this build does not use the network, so that a later one can.
    if network := network_of(config) or (last_network(project) if reapply else ""):
        summary[NETWORK] = network
    ledger.finish(
        project,
        STAGE,
        seconds,
        summary,
        before=graph_in_file(project),
        write_rows=partial(graph_table.write, graph=graph),
    )
    write_bytes(project.layout.measured_map, encode_graph(result.measured))
    project.layout.walls.unlink(missing_ok=True)
    if walls is not None:
        write_walls(project.layout.walls, walls)
    unfinished.unlink(missing_ok=True)
    _check_floor(project, graph, listen)
    listen(
        Done(
            STAGE,
            f"{count_text(len(graph.viewpoints), 'viewpoint')} and {count_text(len(graph.edges), 'edge')}",
            report,
        )
    )


def _walls(project: Project, capture: Capture) -> tuple[WallGrid, ...] | None:
    """The walls that the cloud shows, to find edges through which a glass pane may be. None with a LiDAR scan, or if no
    cloud shows surfaces."""
    from nvsim.mapping.explanation.wall_openings import find_walls

    cloud = project.scan() if capture.trajectory_counts else None
    if cloud is None or not cloud.is_dense:
        return None
    return find_walls(cloud.points, floor_of(project).height_at, capture.positions)


def _photographed_figures(graph: NavGraph, config: MappingConfig, listen: Listener) -> dict[str, float | int]:
    """The mean photographed share of the viewpoints, and the number of those below the threshold. Warns if these are
    most of the viewpoints."""
    shares = [v.photographed for v in graph.viewpoints.values() if v.photographed is not None]
    below = sum(share < config.photographed for share in shares)
    if 2 * below > len(shares):
        listen(
            Warning(
                f"No image shows much of the surroundings of {below} of {len(shares)} viewpoints: less than "
                f"{config.photographed:.0%} of their directions is photographed. Panoramas show haze there. Take more "
                "images in other directions, or exclude these viewpoints (`nvsim graph check` lists them).",
                STAGE,
            )
        )
    return {"photographed": round(float(np.mean(shares)), 4) if shares else 0.0, "hazy_viewpoints": below}


def for_splats(config: MappingConfig) -> MappingConfig:
    """The settings for models whose floor is opaque: instead of the default criteria, depth and slice."""
    return replace(config, criteria=("depth", "slice")) if config.criteria == MappingConfig.criteria else config


def _check_floor(project: Project, graph: NavGraph, listen: Listener) -> None:
    """Warns if most viewpoints have points under their floor, if the cameras have uneven heights above it, or if they
    hardly moved. Then the viewpoints probably stand on furniture."""
    places = np.array([(*v.position[:2], v.position[2] - v.height) for v in graph.viewpoints.values()]).reshape(-1, 3)
    share = share_without_points_below(project.scan(), places)
    if share < _MOST:
        listen(
            Warning(
                f"{1 - share:.0%} of the viewpoints have many points more than 0.2 m under their floor, so they "
                "probably stand on furniture. Import the capture again with the height of the camera above the floor "
                "(--camera-height).",
                STAGE,
            )
        )
    heights = _camera_heights(project)
    meters = short_walk(project.need_capture().positions, heights)
    if meters is not None:
        listen(
            Warning(
                f"The cameras are at most {meters:.1f} m apart, less than their height above the floor that was found. "
                "Images from one place often show a table or a desk instead of the floor. Compare this floor with the "
                "images, and walk through the rooms.",
                STAGE,
            )
        )
    uneven = uneven_height_range(heights)
    if uneven is not None:
        listen(
            Warning(
                f"The cameras are between {uneven[0]:.2f} and {uneven[1]:.2f} m above the floor that was found, which "
                "is uneven for a carried camera, so this floor may be a table or a bed. Compare it with the images; if "
                "it is wrong, take images that show the floor, and walk through the room at one height.",
                STAGE,
            )
        )


def _camera_heights(project: Project) -> NDArray[np.float64]:
    """(N,) heights in meters of the cameras above the floor of the submap that has their image in its core."""
    positions, heights = project.need_capture().positions, []
    for submap in project.submaps("train"):
        surface, own = project.surface(submap.index), positions[list(submap.core)]
        if surface is not None and len(own):
            heights.append(own[:, 2] - surface.height_at(own[:, :2]))
    return np.concatenate([*heights, np.zeros(0)])


def _evidence(path: Path) -> NavGraph | None:
    """The stored evidence, None if it is missing or damaged."""
    try:
        return decode_graph(read_bytes(path))
    except InputError:
        return None


def search_start(capture: Capture, start: str) -> NDArray[np.float64] | None:
    """Start of the search, (3,) meters, world: the position of the named frame, or X,Y at the height of the nearest
    camera. None if `start` is empty. Raises InputError for all other values."""
    if not start:
        return None
    if not capture.has_images and "," not in start:
        raise InputError(f"--start {start} is not X,Y in meters; give one like --start 1.5,2.")
    for frame in capture.frames:
        if start in (frame.name, PurePosixPath(frame.name).stem):
            return frame.camera_to_world[:3, 3]
    try:
        x, y = (float(part) for part in start.split(","))
    except ValueError as error:
        first = capture.frames[0].name if capture.frames else "1.5,2"
        raise InputError(f"--start {start} is not a frame, and not X,Y in meters; try --start {first}.") from error
    apart = np.hypot(*(capture.positions[:, :2] - (x, y)).T)
    if not np.isfinite(apart).all() or apart.min() > _FAR:
        raise InputError(f"--start {start} is more than {_FAR:.0f} m from all cameras; choose a nearer place.")
    return np.array([x, y, capture.positions[int(apart.argmin()), 2]])


def map_key(project: Project, config: MappingConfig) -> str:
    """The key of the graph: all trained submaps, the floor of corrected masks, the thresholds, and the network of the
    criteria."""
    project.need_submaps()
    trained = [ledger.record(project, "train", s.index) for s in project.submaps("train")]
    corrected = corrections_key(project, supporting_frames(project))
    asked = [_DRAWN, *(["second opinion"] if config.second_opinion and len(trained) > 1 else [])]
    capture = project.need_capture()
    if not capture.has_images:
        asked += [capture_key(project), floors_key(project), *ledger.removal_key(project)]
    elif not capture.is_scanned:
        asked.append(f"images alone {_ALONE}, around {config.around}")
    network = [found] if (found := network_of(config)) else []
    return ledger.key_of(STAGE, [t.key if t else "" for t in trained], config.key, *asked, *network, *corrected)


# The normals network. Evidence of one network is not valid for another. -----------------------------------------------


def check_normals(config: MappingConfig) -> None:
    """Raises InputError if the criteria need a normals network and none is installed, the file is not such a network,
    or it cannot process the views."""
    if NETWORK_NORMAL in config.criteria:
        network = installed_normals(config.normals_model)
        if config.views == "panorama" and network.takes_rays:
            raise InputError(
                f"{config.normals_model or 'The normals network'} needs the rays of a camera and cannot process "
                "panoramas; leave --views panorama out, or name another --normals-model."
            )


def network_of(config: MappingConfig) -> str:
    """Digest of the installed network and its description; "" if the criteria need none or none is installed. Raises
    InputError if it cannot be read."""
    model = normals_model(config.normals_model) if NETWORK_NORMAL in config.criteria else None
    if model is None:
        return ""
    return model.digest()


def last_network(project: Project) -> str:
    """Digest of the network of the evidence in the project's map; "" if the evidence is not from a network."""
    last = ledger.record(project, STAGE)
    return "" if last is None else str(last.summary.get(NETWORK, ""))


def without_other_networks(graph: NavGraph | None, project: Project, config: MappingConfig) -> NavGraph | None:
    """`graph` without the evidence of a network that differs from the installed one."""
    asked = network_of(config)
    if graph is None or not asked or asked == last_network(project):
        return graph
    return replace(graph, evidence={key: _as_unseen(evidence) for key, evidence in graph.evidence.items()})


def _as_unseen(evidence: Evidence) -> Evidence:
    second = evidence.second and replace(evidence.second, network_up=None)
    return replace(evidence, network_up=None, second=second)
