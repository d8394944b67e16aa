"""Write the files of a scene that Habitat opens.

`nvsim/SCAN/SCAN.glb` is the surface, the `scene_id` of all episodes. `SCAN_collision.glb` is the collision mesh. The
configurations name both. The frame is Habitat's: y is up, and (x, y, z) of NVSim is (x, z, -y).

The collision mesh is the floor on which robots stand, and the sides of obstacles, from the free space of the scan.
Walls and furniture have sides up to HEIGHT above the floor and no tops, so nothing can stand on them. Steps on stairs
are ramps along the edges of the graph.

Source: habitat-sim, docs/pages/attributesJSON.rst (stage and scene dataset attributes).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.dataset.habitat.surface import SolidColumns, fuse_surface
from nvsim.errors import InputError
from nvsim.events import Listener, ignore_event
from nvsim.files import atomic
from nvsim.graph.connectivity import read_connectivity, scan_files
from nvsim.graph.quantities import slope_of
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.r2r.episodes.episode import scene_id
from nvsim.r2r.episodes.episode_actions import scanned_obstacles, visible_floor
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.observations.stub import SCAN as STUB
from nvsim.r2r.surroundings.layers import Layers, layers_of
from nvsim.r2r.surroundings.visibility import has_depth, views_from_viewpoints
from nvsim.splats.formats.glb import write_colored_glb

CONFIG = "nvsim/nvsim.scene_dataset_config.json"
SMALLEST, LARGEST = 0.02, 0.5
"""Limits of the voxels in meters."""
_GRAY = 160
HEIGHT = 1.8
"""Meters of the sides of obstacles above the floor."""
_FROM, _TO = 0.1, 1.5  # meters above the floor between which surfaces are obstacles; agents of VLN-CE are 1.5 m high
_APART = 0.075  # meters from obstacles of the cloud beyond which the fused surface shows others
_RAMP = 0.4  # half the width of a ramp in meters
_VERTICAL = 0.05  # meters between the ends seen from above; such an edge has no ramp
Rectangle = tuple[int, int, int, int]


@dataclass(frozen=True)
class SceneFiles:
    """The files of a scan, and the numbers of triangles of its surface and its collision mesh."""

    scan: str
    files: tuple[Path, ...]
    triangles: int
    collision_triangles: int


def write_scenes(
    root: Path,
    out: Path,
    scans: tuple[str, ...] = (),
    voxel: float = 0.05,
    clouds: Mapping[str, NDArray[np.floating]] = MappingProxyType({}),
    listen: Listener = ignore_event,
) -> list[SceneFiles]:
    """Writes the scenes of the scans in the export folder `root` below `out`, Habitat's folder of scenes.

    scans   ids, () for all that scans.txt lists
    voxel   meters
    clouds  scan -> (N, 3) points on surfaces, meters, world, which become obstacles too

    Raises InputError if `voxel` is out of range, a scan has no strips with depth, or writing fails.
    """
    if not SMALLEST <= voxel <= LARGEST:
        raise InputError(f"Voxels of {voxel:g} m are out of range; give --voxel {SMALLEST} to {LARGEST}.")
    atomic.refuse_unwritable_folder(out)
    graphs = [read_connectivity(path) for scan, path in scan_files(root, scans).items() if scan != STUB]
    for graph in graphs:
        if not has_depth(ScanPlaces(root, graph.scan), graph):
            raise InputError(f"The scan {graph.scan} has no strips with depth; run `nvsim export scan` first.")
    written = []
    for graph in graphs:
        glb = out / scene_id(graph.scan)
        storeys = list(layers_of(list(views_from_viewpoints(root, graph)), graph))
        surface, columns = fuse_surface(root, graph, voxel, [obstacle_heights(one) for one in storeys], listen)
        write_colored_glb(glb, _to_habitat_axes(surface.vertices), surface.triangles, surface.colors, graph.scan)
        vertices, triangles = collision_mesh(graph, storeys, columns, clouds.get(graph.scan))
        if not len(triangles):
            raise InputError(f"The strips of {graph.scan} show no floor at its viewpoints; check their heights.")
        solid, stage = (glb.with_name(f"{graph.scan}{end}") for end in ("_collision.glb", ".stage_config.json"))
        write_colored_glb(
            solid, _to_habitat_axes(vertices), triangles, np.full((len(vertices), 3), _GRAY, np.uint8), solid.stem
        )
        about = {
            "render_asset": glb.name,
            "collision_asset": solid.name,
            "up": [0.0, 1.0, 0.0],
            "front": [0.0, 0.0, -1.0],
            "units_to_meters": 1.0,
            "shader_type": "flat",
            "requires_lighting": False,
        }
        atomic.write_text(stage, json.dumps(about, indent=1) + "\n")
        written.append(SceneFiles(graph.scan, (glb, solid, stage), len(surface.triangles), len(triangles)))
    stages = {"paths": {".json": ["*/*.stage_config.json"]}}
    atomic.write_text(out / CONFIG, json.dumps({"stages": stages}, indent=1) + "\n")
    return written


def _to_habitat_axes(places: NDArray[np.floating]) -> NDArray[np.float32]:
    """Returns (N, 3) places in Habitat's frame."""
    x, y, z = np.asarray(places, np.float64).T
    return np.stack([x, z, -y], axis=1).astype(np.float32)


def collision_mesh(
    graph: NavGraph,
    storeys: Sequence[Layers],
    columns: Sequence[SolidColumns],
    cloud: NDArray[np.floating] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Returns (N, 3) vertices, meters, world, and (M, 3) triangles, counterclockwise seen from free space.

    columns  of each storey, between `obstacle_heights`
    cloud    (N, 3) points on surfaces, meters, world, which become obstacles too, or None
    """
    quads: list[NDArray[np.float64]] = []
    level: set[str] = set()
    for layers, grid in zip(storeys, columns, strict=True):
        level |= {one.viewpoint.id for one in layers.seen}
        places, blocked = grid.places(), grid.solid
        if cloud is not None:
            blocked = _joined_obstacles(layers.values_at(scanned_obstacles(layers, cloud), places), blocked, grid.voxel)
        floor = _parts_with_viewpoint(layers.values_at(visible_floor(layers), places) & ~blocked, layers, grid)
        quads += [_flat(grid, one, layers.floor) for one in rectangles(floor)]
        for one in rectangles(_obstacles_beside_floor(blocked, floor)):
            quads += list(_sides(grid, one, layers.floor))
    for a, b in graph.edges:
        ends = graph.viewpoints[a], graph.viewpoints[b]
        if math.dist(ends[0].position[:2], ends[1].position[:2]) < _VERTICAL:
            continue
        if a not in level or b not in level or not _is_level(*ends):
            quads.append(_ramp(*ends))
    vertices = np.concatenate(quads) if quads else np.zeros((0, 3))
    first = np.arange(0, len(vertices), 4)[:, None]
    return vertices, np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])


def obstacle_heights(layers: Layers) -> tuple[float, float]:
    """Returns world z between which surfaces of a storey are obstacles, in meters."""
    return layers.floor + _FROM, layers.floor + _TO


def rectangles(mask: NDArray[np.bool_]) -> Iterator[Rectangle]:
    """Yields disjoint rectangles (first row, end row, first column, end column) that cover the cells of a mask.

    Equal runs of consecutive rows become one rectangle.
    """
    growing: dict[tuple[int, int], int] = {}
    for row in range(mask.shape[0] + 1):
        line = np.zeros(mask.shape[1] + 2, np.int8)
        if row < mask.shape[0]:
            line[1:-1] = mask[row]
        changes = np.flatnonzero(np.diff(line))
        runs = set(zip(changes[::2].tolist(), changes[1::2].tolist()))
        for run in [run for run in growing if run not in runs]:
            yield growing.pop(run), row, *run
        for run in runs:
            growing.setdefault(run, row)


def _parts_with_viewpoint(floor: NDArray[np.bool_], layers: Layers, grid: SolidColumns) -> NDArray[np.bool_]:
    """Returns the parts of the floor with a viewpoint; others are seen through windows."""
    _, labels = cv2.connectedComponents(floor.astype(np.uint8), connectivity=4)
    at = grid.values_at(labels, np.array([one.viewpoint.position[:2] for one in layers.seen]))
    return np.isin(labels, at[at > 0])


def _obstacles_beside_floor(blocked: NDArray[np.bool_], floor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns the obstacles that touch the floor; robots do not reach the others."""
    return blocked & cv2.dilate(floor.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)


def _joined_obstacles(scanned: NDArray[np.bool_], fused: NDArray[np.bool_], voxel: float) -> NDArray[np.bool_]:
    """Returns the obstacles of the cloud, and those of the fused surface that the cloud lacks.

    Beside an obstacle of the cloud, the surface is ignored: both estimates of one edge together would make every
    obstacle thicker."""
    apart = cv2.distanceTransform((~scanned).astype(np.uint8), cv2.DIST_L2, 5) * voxel > _APART
    return np.asarray(scanned | (fused & apart))


def _corners(grid: SolidColumns, one: Rectangle) -> NDArray[np.float64]:
    """Returns (4, 2) the corners of a rectangle, meters, counterclockwise from above."""
    top, bottom, left, right = one
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]]) * grid.voxel + (
        np.array(grid.low) - grid.voxel / 2
    )


def _flat(grid: SolidColumns, one: Rectangle, z: float) -> NDArray[np.float64]:
    return np.column_stack([_corners(grid, one), np.full(4, z)])


def _sides(grid: SolidColumns, one: Rectangle, low: float) -> Iterator[NDArray[np.float64]]:
    corners, high = _corners(grid, one), low + HEIGHT
    for a, b in zip(corners, np.roll(corners, -1, axis=0)):
        yield np.array([[*a, low], [*b, low], [*b, high], [*a, high]])


def _is_level(a: Viewpoint, b: Viewpoint) -> bool:
    way = np.subtract(b.position, a.position)
    return slope_of(float(way[2]), float(np.linalg.norm(way))) == "level"


def _ramp(a: Viewpoint, b: Viewpoint) -> NDArray[np.float64]:
    """Returns (4, 3) a strip of floor along an edge."""
    start, stop = (np.array([*v.position[:2], v.position[2] - v.height]) for v in (a, b))
    x, y = (stop - start)[:2] / np.linalg.norm((stop - start)[:2])
    across = np.array([y, -x, 0.0]) * _RAMP
    return np.array([start + across, stop + across, stop - across, start - across])
