"""Find the ground truth of a project, and convert its maps to the aligned frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Capture, Frame
from nvsim.errors import InputError
from nvsim.occupancy.storeys import StoreyMap, StoreyMaps, is_storeys, read_storeys
from nvsim.occupancy.types import Heights, OccupancyMap, transformed_map
from nvsim.perception.segment import read_mask
from nvsim.project.occupancy_maps import refuse_own_depth, true_map
from nvsim.project.project import Project


def true_mask(folder: Path, kind: str, frame_name: str) -> Path | None:
    """`folder/kind/NAME.png` (or `folder/NAME.png` for floors) of a frame called PATH/NAME.jpg; None if missing."""
    name = PurePosixPath(frame_name).stem + ".png"
    for path in (folder / kind / name, folder / name if kind == "floor" else folder / kind / name):
        if path.is_file():
            return path
    return None


def read_true_mask(path: Path, frame: Frame, width: int, height: int) -> NDArray[np.bool_]:
    """(height, width) bool: a true mask of the stored image of `frame`, as its upright view without a border shows it.
    Raises InputError if it is missing or not an image."""
    mask = np.ascontiguousarray(frame.lens.upright(read_mask(path)))
    if mask.shape == (height, width):
        return mask
    way = cv2.INTER_AREA if mask.shape[0] > height or mask.shape[1] > width else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(mask.astype(np.uint8) * 255, (width, height), interpolation=way) > 127)


def truth_folder(project: Project, truth: Path | None) -> Path:
    """The ground truth folder. Raises InputError if it does not exist."""
    folder = truth or project.layout.ground_truth
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder of true masks; name one with --truth DIR.")
    return folder


def truth_of(project: Project, truth: Path | None) -> Path | None:
    """The given ground truth folder, else the project's own, None if there is neither. Raises InputError if the given
    folder does not exist."""
    if truth is not None and not truth.is_dir():
        raise InputError(f"{truth} is not a folder; name the folder that contains floor/ masks with --truth DIR.")
    return truth or (project.layout.ground_truth if project.layout.ground_truth.is_dir() else None)


def true_maps(
    project: Project, path: Path | None, frame: str, heights: Heights | None = None
) -> OccupancyMap | StoreyMaps:
    """The true maps of a project, in its aligned frame, limited to `heights` if the source has heights. `path` is one
    map, or a folder or .json file that names the maps of storeys. Without it, the maps are those of the built-in
    building, or the one built for the project.

    Raises InputError if there is none, or if it was made from the project's own models.
    """
    truth = path or true_map(project)
    if truth is None:
        raise InputError(
            f"{project.layout.root} has no true map; name one with --occupancy MAP, or build one with "
            "`nvsim occupancy build --project`."
        )
    if not is_storeys(truth):
        refuse_own_depth(truth, project)
    return maps_in_aligned_frame(truth, project.need_capture(), frame, heights)


def true_occupancy(project: Project, path: Path | None, frame: str, heights: Heights | None = None) -> OccupancyMap:
    """`true_maps` for functions that need a single map. Raises InputError also if there are several storeys."""
    found = true_maps(project, path, frame, heights)
    if isinstance(found, StoreyMaps):
        raise InputError(
            f"{path or project.layout.ground_truth} has maps of several storeys, which only `nvsim evaluate graph` "
            "supports; name the map of one storey with --occupancy MAP."
        )
    return found


def maps_in_aligned_frame(
    path: Path, capture: Capture, frame: str, heights: Heights | None = None
) -> OccupancyMap | StoreyMaps:
    """The map at `path`, or the maps of storeys that a folder or a .json file names, limited to `heights` if the source
    has heights. If `frame` is the capture's own frame, they are converted to the aligned frame. Raises InputError if
    the capture's frame is not upright."""
    from nvsim.occupancy.read import read_map

    maps = read_storeys(path, heights) if is_storeys(path) else read_map(path, heights)
    alignment = capture.alignment
    if frame == "aligned" or alignment.is_identity:
        return maps
    if alignment.rotation[2, 2] < np.cos(np.radians(2.0)):
        raise InputError(f"{path} cannot be in the capture's frame, which is not z-up; use --map-frame aligned.")
    turn, scale, (left, down, low) = alignment.rotation[:2, :2], alignment.scale, alignment.origin
    shift = (-left, -down)

    def align_map(found: OccupancyMap) -> OccupancyMap:
        near = replace(found, origin=(found.origin[0] - left, found.origin[1] - down))
        return transformed_map(near, turn, scale=scale)

    if isinstance(maps, OccupancyMap):
        return align_map(maps)
    return StoreyMaps(
        tuple(StoreyMap(scale * (s.floor - low), align_map(s.occupancy)) for s in maps.storeys),
        tuple(replace(s, outline=_rotate_outline(s.outline, scale * turn, shift)) for s in maps.stairs),
    )


def _rotate_outline(
    outline: tuple[tuple[float, float], ...], turn: NDArray[np.float64], shift: tuple[float, float]
) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in (np.array(outline) + shift) @ turn.T)
