"""The truth of the building: occupancy from its boxes, floor, transient, depth and normals from a rendered view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from nvsim.building.raycast import normal
from nvsim.building.rendering import View
from nvsim.building.scene import Scene
from nvsim.occupancy.heights import Heights
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

RESOLUTION = 0.05  # metres per cell
LOW, HIGH = Heights().from_height, Heights().to_height  # what stands in a robot's way, metres above the floor
_BORDER = 0.5  # metres around the building


def occupancy(scene: Scene) -> OccupancyMap:
    """Occupied: cells that a solid (glass included, people not) between LOW and HIGH overlaps. Free: the floor
    connected with the trajectory. Unknown: the rest."""
    extent = scene.plan.extent
    rows, columns = (int(np.ceil((v + 2 * _BORDER) / RESOLUTION - 1e-6)) for v in (extent.y1, extent.x1))
    solid = np.zeros((rows, columns), bool)
    for box in scene.boxes:
        if box.lo[2] < HIGH and box.hi[2] > LOW:
            c0, r0 = (int(np.floor((v + _BORDER) / RESOLUTION + 1e-6)) for v in box.lo[:2])
            c1, r1 = (int(np.ceil((v + _BORDER) / RESOLUTION - 1e-6)) for v in box.hi[:2])
            solid[r0:r1, c0:c1] = True
    cells = np.full((rows, columns), UNKNOWN, np.uint8)
    empty = OccupancyMap(cells, RESOLUTION, (-_BORDER, -_BORDER))
    regions, _ = ndimage.label(~solid)
    index = empty.index(scene.path[:, :2])
    walked = np.unique(regions[index[:, 0], index[:, 1]])
    cells[np.isin(regions, walked[walked > 0])] = FREE
    cells[solid] = OCCUPIED
    return OccupancyMap(cells, RESOLUTION, (-_BORDER, -_BORDER))


def floor_mask(scene: Scene, view: View) -> NDArray[np.bool_]:
    """(H, W): pixels that show the floor, also through glass; a person on it is not floor."""
    return np.asarray(view.surface == scene.floor_surface)


def transient_mask(scene: Scene, view: View) -> NDArray[np.bool_]:
    """(H, W): pixels that show a person."""
    return np.asarray(view.surface >= scene.floor_surface + 2)


def normals(scene: Scene, view: View) -> NDArray[np.float32]:
    """(H, W, 3) unit world normals towards the camera; zero on people."""
    table = np.array([normal(s, len(scene.boxes)) for s in range(scene.floor_surface + 2)] + [(0.0, 0.0, 0.0)])
    return np.asarray(table[np.minimum(view.surface, scene.floor_surface + 2)], np.float32)
