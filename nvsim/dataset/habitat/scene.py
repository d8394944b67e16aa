"""Write the files of a scene that Habitat opens.

`nvsim/SCAN/SCAN.glb` is the surface, the `scene_id` of all episodes. `SCAN_collision.glb` is the collision mesh. The
configurations name both. The frame is Habitat's: y is up, and (x, y, z) of NVSim is (x, z, -y).

Source: habitat-sim, docs/pages/attributesJSON.rst (stage and scene dataset attributes).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nvsim.dataset.habitat.collision import collision_mesh, obstacle_heights
from nvsim.dataset.habitat.surface import fuse_surface
from nvsim.errors import InputError
from nvsim.events import Listener, ignore_event
from nvsim.files import atomic
from nvsim.graph.connectivity import read_connectivity, scan_files
from nvsim.r2r.episodes.episode import scene_id
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.observations.stub import SCAN as STUB
from nvsim.r2r.surroundings.layers import layers_of
from nvsim.r2r.surroundings.visibility import has_depth, views_from_viewpoints
from nvsim.splats.formats.glb import write_colored_glb

CONFIG = "nvsim/nvsim.scene_dataset_config.json"
SMALLEST, LARGEST = 0.02, 0.5
"""Limits of the voxels in meters."""
_GREY = 160


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
    graphs = [read_connectivity(path) for scan, path in scan_files(root, scans).items() if scan != STUB]
    for graph in graphs:
        if not has_depth(ScanPlaces(root, graph.scan), graph):
            raise InputError(f"The scan {graph.scan} has no strips with depth; run `nvsim export scan` first.")
    written = []
    for graph in graphs:
        glb = out / scene_id(graph.scan)
        storeys = list(layers_of(list(views_from_viewpoints(root, graph)), graph))
        surface, columns = fuse_surface(root, graph, voxel, [obstacle_heights(one) for one in storeys], listen)
        write_colored_glb(glb, _turned(surface.vertices), surface.triangles, surface.colors, graph.scan)
        vertices, triangles = collision_mesh(graph, storeys, columns, clouds.get(graph.scan))
        if not len(triangles):
            raise InputError(f"The strips of {graph.scan} show no floor at its viewpoints; check their heights.")
        solid, stage = (glb.with_name(f"{graph.scan}{end}") for end in ("_collision.glb", ".stage_config.json"))
        write_colored_glb(solid, _turned(vertices), triangles, np.full((len(vertices), 3), _GREY, np.uint8), solid.stem)
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


def _turned(places: NDArray[np.floating]) -> NDArray[np.float32]:
    """Returns (N, 3) places in Habitat's frame."""
    x, y, z = np.asarray(places, np.float64).T
    return np.stack([x, z, -y], axis=1).astype(np.float32)
