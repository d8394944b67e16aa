"""Align the Gaussians of a splat file: z up, meters; and find its storeys."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.rotation import smallest_rotation
from nvsim.scene_import.levels import Storeys, find_storeys
from nvsim.scene_import.surface_points import SurfacePoints, central_box, surface_points
from nvsim.scene_import.up_direction import find_up, storey_height
from nvsim.splats.turning import UPS, Up, transform_gaussians
from nvsim.splats.types import Gaussians

CEILING_HEIGHT = 2.6
"""Meters: the usual height of rooms, from which a missing scale is estimated."""
_METRIC = (2.1, 4.6)  # units: rooms this high have meters as unit
_CELLS = 250  # along the longest side of a scene, for the up direction
_CELL = 0.05  # meters, for the storeys
_COARSE = 5000  # a coordinate must be finer than the extent of the scene by this factor
_LEAST = 500  # Gaussians of a building
_MISSING = {
    "floor": "has no floor: no horizontal surface has room to stand above; choose a splat of the inside of a building"
    ", or name its up axis with --up",
    "ceiling": "has no ceiling above its floor, so it shows an object or the outside of a building; NVSim needs the "
    "inside of a building. Name its up axis with --up if it is upside down",
    "room": "has no free floor that walls enclose and a ceiling covers; NVSim needs the inside of a building with room "
    "to stand",
}


@dataclass(frozen=True, eq=False)
class AlignedScene:
    """gaussians    z up, meters
    surface      points of these Gaussians
    rotation     (3, 3): aligned = scale * rotation @ (x in the file)
    scale        meters per unit of the file
    scale_known  whether the user gave the scale, or the height of the rooms shows that the unit is a meter
    storeys      at least one
    notes        sentences about the up direction and the scale
    doubts       sentences that the user should check
    """

    gaussians: Gaussians
    surface: SurfacePoints
    rotation: NDArray[np.float64]
    scale: float
    scale_known: bool
    storeys: Storeys
    notes: tuple[str, ...]
    doubts: tuple[str, ...]


def axis_of(up: Up) -> NDArray[np.float64]:
    """(3,) unit vector of a named axis."""
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up.startswith("-") else 1.0
    return axis


def align_scene(
    name: str, gaussians: Gaussians, convention: Up, up: str = "auto", scale: float | None = None
) -> AlignedScene:
    """The scene `name` with z up in meters, and its storeys.

    convention  up axis of most files of this format
    up          the up axis that the user gives, or "auto"
    scale       meters per unit that the user gives

    Raises InputError with one sentence if the scene is not the inside of a building.
    """
    if scale is not None and not (np.isfinite(scale) and 0 < scale < 1e6):
        raise InputError(f"--scale {scale:g} is not a positive number of meters; give one like 1.2.")
    if len(gaussians) < _LEAST:
        raise InputError(
            f"{name} has {len(gaussians)} Gaussians, which are too few for a building; choose a splat of the inside of "
            "a building."
        )
    low, high = central_box(gaussians.means)
    _refuse_far(name, low, high)
    surface = surface_points(gaussians, float((high - low).max()) / _CELLS)
    found = find_up(surface, axis_of(convention), axis_of(up) if up in UPS else None)
    if found is None:
        raise InputError(f"{name} {_MISSING['floor']}.")
    rotation = smallest_rotation(found.up, np.array([0.0, 0.0, 1.0])) if found.up[2] < 1 else np.eye(3)
    notes, doubts = [f"Up is {_words(found.up)} in the file."], []
    if not found.sure:
        doubts.append(
            f"{name}: the surfaces do not show which side is up; {_words(found.up)} is assumed. If the rooms are "
            "upside down, import again with --up."
        )
    known, height = scale is not None, storey_height(surface, found.up)
    if scale is None:
        known = height is not None and _METRIC[0] <= height <= _METRIC[1]
        scale = 1.0 if known or height is None else CEILING_HEIGHT / height
        if known:
            notes.append(
                f"The rooms are {height:.2f} units high, so a unit is taken as a meter (--scale changes that)."
            )
        elif height is None:
            doubts.append(
                f"{name}: no ceiling shows the height of the rooms, so a unit is taken as a meter; if this is wrong, "
                "import again with --scale and the meters per unit."
            )
        else:
            doubts.append(
                f"{name}: the rooms are {height:.3g} units high, so its unit is unknown. A ceiling height of "
                f"{CEILING_HEIGHT} m is assumed, which is uncertain by about 15 %; import again with --scale "
                f"{scale:.4g} to confirm it, or with the correct meters per unit."
            )
    if not (scale == 1.0 and np.array_equal(rotation, np.eye(3))):
        gaussians = transform_gaussians(gaussians, rotation, scale)
    surface = points_of(gaussians)
    storeys = find_storeys(gaussians, surface)
    if not storeys.levels:
        raise InputError(f"{name} {_MISSING[storeys.missing]}.")
    return AlignedScene(gaussians, surface, rotation, scale, known, storeys, tuple(notes), tuple(doubts))


def points_of(gaussians: Gaussians) -> SurfacePoints:
    """The surface points of an aligned scene, from which storeys are found."""
    return surface_points(gaussians, _CELL, 600_000 if len(gaussians) < 300_000 else 1_500_000)


def _refuse_far(name: str, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
    extent, farthest = float((high - low).max()), float(np.abs([low, high]).max())
    if extent <= 1e-6 or np.spacing(np.float32(farthest)) * _COARSE > extent:
        raise InputError(
            f"{name} has coordinates of {farthest:.3g} units for a scene of {extent:.3g} units, which 32-bit numbers "
            "store too coarsely; export it with its origin in the building."
        )


def _words(up: NDArray[np.float64]) -> str:
    for name in UPS:
        if np.allclose(up, axis_of(name)):
            return name
    return "({:.3f}, {:.3f}, {:.3f})".format(*up)
