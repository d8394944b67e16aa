"""Finds the truth that a project is scored against, and brings it into the aligned frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from nvsim.capture.types import Alignment, Capture
from nvsim.errors import InputError
from nvsim.occupancy.storeys import StoreyMap, StoreyMaps, read_storeys
from nvsim.occupancy.types import UNKNOWN, OccupancyMap
from nvsim.project.project import Project


def true_mask(folder: Path, kind: str, frame_name: str) -> Path | None:
    """`folder/kind/NAME.png` (or `folder/NAME.png` for floors) of a frame called PATH/NAME.jpg; None where missing."""
    name = PurePosixPath(frame_name).stem + ".png"
    for path in (folder / kind / name, folder / name if kind == "floor" else folder / kind / name):
        if path.is_file():
            return path
    return None


def truth_folder(project: Project, truth: Path | None) -> Path:
    """The folder to score against. Raises InputError when there is none."""
    folder = truth or project.layout.ground_truth
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder of true masks; name one with --truth DIR.")
    return folder


def truth_of(project: Project, truth: Path | None) -> Path | None:
    """The folder to score against: the given one, else the project's own truth, None where there is none."""
    if truth is not None and not truth.is_dir():
        raise InputError(f"{truth} is not a folder; name the folder that holds floor/ masks with --truth DIR.")
    return truth or (project.layout.ground_truth if project.layout.ground_truth.is_dir() else None)


def evaluate_project_floor(project: Project, truth: Path | None) -> dict[str, Any]:
    """The floor figures of the masks that the machine found, without a user's corrections; also kept as the project's
    result "floor" where it can be written."""
    from nvsim.evaluation.floor import evaluate_floor

    folder = truth_folder(project, truth)
    frames = project.need_capture().frames
    pairs = {i: true_mask(folder, "floor", f.name) for i, f in enumerate(frames)}
    found = [(project.layout.mask(i), p) for i, p in pairs.items() if p is not None]
    if not found:
        raise InputError(f"{folder} has no mask for any frame (looked for floor/{Path(frames[0].name).stem}.png).")
    missing = next((m for m, _ in found if not m.is_file()), None)
    if missing is not None:
        raise InputError(f"{missing} is missing; run `nvsim floors --project` first.")
    return evaluate_floor(found)


def maps_in_aligned_frame(path: Path, capture: Capture, frame: str) -> OccupancyMap | StoreyMaps:
    """The map at `path`, or those of the storeys that a folder or a .json file names, brought from the capture's own
    frame when `frame` says so. Raises InputError when that frame is not upright."""
    from nvsim.occupancy.read import read_map

    several = path.is_dir() or path.suffix.lower() == ".json"
    maps = read_storeys(path) if several else read_map(path)
    alignment = capture.alignment
    if frame == "aligned" or alignment.is_identity:
        return maps
    if alignment.rotation[2, 2] < np.cos(np.radians(2.0)):
        raise InputError(f"{path} cannot be in the capture's frame, which is not z-up; use --map-frame aligned.")
    if isinstance(maps, OccupancyMap):
        return _aligned(maps, alignment)
    turn = alignment.scale * alignment.rotation[:2, :2]
    return StoreyMaps(
        tuple(StoreyMap(alignment.scale * s.floor, _aligned(s.occupancy, alignment)) for s in maps.storeys),
        tuple(
            replace(s, outline=tuple((float(x), float(y)) for x, y in np.array(s.outline) @ turn.T))
            for s in maps.stairs
        ),
    )


def _aligned(occupancy: OccupancyMap, alignment: Alignment) -> OccupancyMap:
    """The map on the cells of the aligned frame."""
    rotation = alignment.rotation
    resolution = occupancy.resolution * alignment.scale
    rows, columns = occupancy.cells.shape
    size = np.array([columns, rows]) * occupancy.resolution
    corners = np.array(occupancy.origin) + np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * size
    turned = alignment.scale * corners @ rotation[:2, :2].T
    low, high = turned.min(axis=0), turned.max(axis=0)
    shape = np.ceil((high - low) / resolution).astype(int)[::-1]
    empty = OccupancyMap(np.full(shape, UNKNOWN, np.uint8), resolution, (float(low[0]), float(low[1])))
    back = empty.centres() @ rotation[:2, :2] / alignment.scale
    return OccupancyMap(occupancy.at(back), resolution, empty.origin)
