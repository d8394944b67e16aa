"""The floor surface of every submap, made once."""

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
    """Submap index -> its floor; those that are committed stay. Where storeys lie over one another, a submap has the
    floor of its storey, and stairs are found last: how high the cameras were carried is known from the storeys."""
    positions = project.need_capture().positions
    storeys = storeys_of(positions)
    found: dict[int, FloorSurface] = {}
    for submap in sorted(submaps, key=lambda s: _part(s, storeys) % 2):
        with contextlib.suppress(InputError):  # a damaged one is made again
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
    """The storey or stair that most of a submap's core is on, as `TrajectoryStoreys.part` counts."""
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
    # The neighbours' frames on a stair would bend the floor of the room beside it.
    level = [i for i in frames if storeys.part[i] == part]
    return estimate_floor(project.scan(), positions[level], config.camera_height, above_another=part > 0)


def _carried(
    positions: NDArray[np.float64],
    storeys: TrajectoryStoreys,
    found: dict[int, FloorSurface],
    submaps: tuple[Submap, ...],
) -> float:
    """Metres from the floors that were found to the cameras over them, the usual ones."""
    heights = [
        positions[i, 2] - float(found[s.index].height_at(positions[i, :2]))
        for s in submaps
        if s.index in found
        for i in s.core
        if storeys.part[i] % 2 == 0
    ]
    return float(np.median(heights))
