"""Estimates the floor surface of each submap."""

from __future__ import annotations

import contextlib

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.atomic import replacing
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.submaps.storeys import TrajectoryStoreys, storeys_of
from nvsim.submaps.types import Submap


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
        surface = _estimated(project, submap, storeys, config, found, submaps)
        with replacing(project.layout.surface(submap.index)) as path:
            np.savez(path, heights=surface.heights, origin=np.array(surface.origin), spacing=surface.spacing)
        found[submap.index] = surface
    return found


def _part(submap: Submap, storeys: TrajectoryStoreys) -> int:
    """The storey or stair of most frames in a submap's core, as numbered in `TrajectoryStoreys.part`."""
    return int(np.bincount(storeys.part[list(submap.core)]).argmax())


def _estimated(
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
        return stair_floor(positions[frames], _carried(positions, storeys, found, submaps))
    # Frames of neighbors on a stair would bend the floor of the room beside it.
    level = [i for i in frames if storeys.part[i] == part]
    return estimate_floor(project.scan(), positions[level], config.camera_height, above_another=part > 0)


def _carried(
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
