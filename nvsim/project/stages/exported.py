"""Exports the results of a project for other programs: its graph as R2R files, and its models as splat files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from nvsim.errors import InputError
from nvsim.events import Listener, Progress, ignore_event
from nvsim.files import atomic
from nvsim.project.occupancy_maps import occupancy_of
from nvsim.project.project import Project
from nvsim.project.work import missing_result_error
from nvsim.splats.floor_mesh import FloorMesh, floor_gaussians, floor_mesh
from nvsim.splats.formats.choice import SUFFIXES, Format, write_splats
from nvsim.splats.formats.glb import write_glb
from nvsim.splats.turning import transform_gaussians
from nvsim.splats.types import joined


def export_r2r(project: Project, out: Path, scan: str | None, frame: str, force: bool = False) -> Path:
    """Writes `<scan>_connectivity.json` and scans.txt into `out`, and returns the path of the connectivity file.

    scan   scan id, None for that of the project
    frame  "aligned", or "capture", which undoes the alignment
    force  export even if agents cannot use the graph

    `visible` is line of sight on the project's occupancy map, if it has one. Raises InputError if there is no graph, if
    the frame of the capture is not upright, or if agents cannot use the graph and `force` is not set.
    """
    from nvsim.graph.connectivity import write_connectivity
    from nvsim.graph.exports import check_exportable
    from nvsim.graph.sight import lines_of_sight

    graph = replace(project.need_graph(), scan=scan or project.scan_name)
    if not force:
        check_exportable(graph)
    visible = lines_of_sight(graph, occupancy_of(project))  # by viewpoint id, so the frame does not matter
    if frame == "capture":
        alignment = project.need_capture().alignment
        if np.degrees(np.arccos(np.clip(alignment.rotation[2, 2], -1, 1))) > 2.0:
            raise InputError(
                f"The frame of the capture is not z-up, but R2R needs z up; export {project.layout.root} with "
                "--frame aligned."
            )
        from nvsim.capture.alignment import to_capture_frame

        moved = {}
        for id, v in graph.viewpoints.items():
            x, y, z = to_capture_frame(np.array([v.position]), alignment)[0]
            moved[id] = replace(v, position=(float(x), float(y), float(z)), height=v.height / alignment.scale)
        graph = replace(graph, viewpoints=moved)
    return write_connectivity(graph, out, visible)


STAGE = "export"
FloorForm = Literal["mesh", "gaussians"]


def export_splats(
    project: Project,
    out: Path,
    form: Format,
    only: tuple[int, ...] = (),
    frame: str = "aligned",
    listen: Listener = ignore_event,
    floor_as: FloorForm = "mesh",
) -> list[Path]:
    """Writes `submap_NNN` with the suffix of the format, `submap_NNN_floor.glb` if the model has a floor texture, and
    splats.json. Returns the written paths. With `floor_as` "gaussians", the floor is in the splat file instead.

    If colors depend on the camera's position, the files have the colors as seen from the mean position of the submap's
    cameras. `frame` "capture" undoes the alignment, but not the origin of far coordinates. The 32-bit numbers of splat
    files are too coarse for these, so splats.json names the origin to add.

    Raises InputError if a submap is unknown or not trained, or the disk reports an error.
    """
    scene, capture = project.scene(), project.need_capture()
    if scene is None:
        raise missing_result_error(project.layout.root, "train")
    missing = sorted(set(only) - set(scene.indices))
    if missing:
        raise InputError(f"Submap {missing[0]} is not trained; trained are {', '.join(map(str, scene.indices))}.")
    chosen = [
        s for s in project.submaps_as_cut("train") if s.index in (only or scene.indices) and s.index in scene.indices
    ]
    atomic.make_folder(out)
    alignment = capture.alignment
    back, shrink = alignment.rotation.T, 1 / alignment.scale
    moved = frame == "capture" and not alignment.is_identity
    written: list[Path] = []
    notes: list[dict[str, Any]] = []
    for done, submap in enumerate(chosen):
        listen(Progress(STAGE, done, len(chosen)))
        model = scene.model(submap.index)
        # The frame numbers of a previous cut may not match those of the present capture.
        former = project.uses_previous_submaps("train") or not project.has_cut_of_capture()
        places = submap.positions if former else capture.positions[list(submap.frames)]
        middle = np.mean(places, axis=0)
        gaussians, mesh = model.gaussians_at(middle), None
        if floor_as == "mesh":
            mesh = floor_mesh(model)
        elif (known := floor_gaussians(model)) is not None:
            gaussians = joined(gaussians, known)
        if moved:
            gaussians = transform_gaussians(gaussians, back, shrink)
            mesh = None if mesh is None else _transform_mesh(mesh, back, shrink)
        name = f"submap_{submap.index:03d}"
        splats, floor = out / f"{name}{SUFFIXES[form]}", out / f"{name}_floor.glb"
        write_splats(splats, gaussians, model.antialiased, form)
        written.append(splats)
        if mesh is not None:
            write_glb(floor, mesh, f"{name} floor")
            written.append(floor)
        notes.append(
            {
                "submap": submap.index,
                "splats": splats.name,
                "floor": None if mesh is None else floor.name,
                "gaussians": len(gaussians),
                "sh_degree": gaussians.sh_degree,
                "antialiased": model.antialiased,
                "colours_seen_from": middle.tolist() if model.appearance is not None else None,
            }
        )
    listen(Progress(STAGE, len(chosen), len(chosen)))
    about = {
        "format": form,
        "frame": frame,
        "up": (back @ [0.0, 0.0, 1.0] if moved else np.array([0.0, 0.0, 1.0])).round(9).tolist(),
        "metres_per_unit": alignment.scale if moved else 1.0,
        "metric": alignment.scale_known,
        "origin": list(alignment.origin) if moved else [0.0, 0.0, 0.0],
        "origin_means": "add it to every coordinate of the files to get those of the capture" if moved else "",
        "axes_of_spz_files": "right, up, back; the other files keep the frame's own axes",
        "submaps": notes,
    }
    atomic.write_text(out / "splats.json", json.dumps(about, indent=1) + "\n")
    return [*written, out / "splats.json"]


def _transform_mesh(mesh: FloorMesh, rotation: np.ndarray, scale: float) -> FloorMesh:
    return replace(mesh, vertices=(scale * (mesh.vertices @ rotation.T)).astype(np.float32))
