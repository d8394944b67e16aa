"""Exports trained models: splat files, a textured floor mesh beside each, and a description of their frame."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from nvsim.errors import InputError
from nvsim.events import Listener, Progress, silent
from nvsim.files import atomic
from nvsim.project.project import Project
from nvsim.project.work import lacks
from nvsim.splats.floor_mesh import FloorMesh, floor_mesh, write_glb
from nvsim.splats.formats.choice import SUFFIXES, Format, write_splats
from nvsim.splats.turning import turned

STAGE = "export"


def export_splats(
    project: Project,
    out: Path,
    form: Format,
    only: tuple[int, ...] = (),
    frame: str = "aligned",
    listen: Listener = silent,
) -> list[Path]:
    """Writes `submap_NNN` with the suffix of the format, `submap_NNN_floor.glb` if the model has a floor texture, and
    splats.json. Returns the written paths.

    If colors depend on the camera's position, the files have the colors as seen from the mean position of the submap's
    cameras. `frame` "capture" undoes the alignment, but not the origin of far coordinates. The 32-bit numbers of splat
    files are too coarse for these, so splats.json names the origin to add.

    Raises InputError if a submap is unknown or not trained, or the disk reports an error.
    """
    scene, capture = project.scene(), project.need_capture()
    if scene is None:
        raise lacks(project.layout.root, "train")
    missing = sorted(set(only) - set(scene.indices))
    if missing:
        raise InputError(f"Submap {missing[0]} is not trained; trained are {', '.join(map(str, scene.indices))}.")
    chosen = [s for s in project.submaps("train") if s.index in (only or scene.indices) and s.index in scene.indices]
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
        former = project.is_former("train")
        places = submap.positions if former else capture.positions[list(submap.frames)]
        middle = np.mean(places, axis=0)
        gaussians, mesh = model.gaussians_at(middle), floor_mesh(model)
        if moved:
            gaussians = turned(gaussians, back, shrink)
            mesh = None if mesh is None else _moved(mesh, back, shrink)
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


def _moved(mesh: FloorMesh, rotation: np.ndarray, scale: float) -> FloorMesh:
    return replace(mesh, vertices=(scale * (mesh.vertices @ rotation.T)).astype(np.float32))
