"""The ground truth of the building: occupancy from its boxes; floor, transient, and normal maps from a rendered
view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from nvsim.building.raycast import normal
from nvsim.building.rendering import View
from nvsim.building.scene import Scene
from nvsim.occupancy.storeys import Stair, StoreyMap, StoreyMaps
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, Heights, OccupancyMap

RESOLUTION = 0.05  # meters per cell
LOW, HIGH = Heights().from_height, Heights().to_height  # meters above the floor between which solids are obstacles
_BORDER = 0.5  # meters around the building


def occupancy(scene: Scene, storey: int = 0) -> OccupancyMap:
    """The occupancy map of a storey. Occupied: cells with a solid (including glass, without people) between LOW and
    HIGH above its floor. Free: the floor connected with the trajectory on it. Unknown: the rest. The treads of stairs
    are free floor of both storeys that they join."""
    level = scene.storeys[storey].floor
    extent = scene.plan.extent
    rows, columns = (int(np.ceil((v + 2 * _BORDER) / RESOLUTION - 1e-6)) for v in (extent.y1, extent.x1))
    solid = np.zeros((rows, columns), bool)
    for box in scene.boxes:
        if box.lo[2] < level + HIGH and box.hi[2] > level + LOW and not box.tread:
            c0, r0 = (int(np.floor((v + _BORDER) / RESOLUTION + 1e-6)) for v in box.lo[:2])
            c1, r1 = (int(np.ceil((v + _BORDER) / RESOLUTION - 1e-6)) for v in box.hi[:2])
            solid[r0:r1, c0:c1] = True
    cells = np.full((rows, columns), UNKNOWN, np.uint8)
    empty = OccupancyMap(cells, RESOLUTION, (-_BORDER, -_BORDER))
    regions, _ = ndimage.label(~solid)
    index = empty.index(scene.path[_on_storey(scene.path, level), :2])
    walked = np.unique(regions[index[:, 0], index[:, 1]])
    cells[np.isin(regions, walked[walked > 0])] = FREE
    cells[solid] = OCCUPIED
    return OccupancyMap(cells, RESOLUTION, (-_BORDER, -_BORDER))


def true_occupancy(scene: Scene) -> StoreyMaps:
    """The map of every storey, and the stairs between two."""
    maps = tuple(StoreyMap(s.floor, occupancy(scene, k)) for k, s in enumerate(scene.storeys))
    flight = scene.plan.flight
    if flight is None:
        return StoreyMaps(maps)
    x0, y0, x1, y1 = flight.rect.corners
    return StoreyMaps(maps, (Stair(0, 1, ((x0, y0), (x1, y0), (x1, y1), (x0, y1))),))


def _on_storey(path: NDArray[np.float64], level: float) -> NDArray[np.bool_]:
    """(N,) bool: which of the places `path` (N, 5) are on the storey with its floor at `level` meters."""
    return np.asarray(np.abs(path[:, 3] - level) < LOW)


def floor_mask(scene: Scene, view: View) -> NDArray[np.bool_]:
    """(H, W) bool: pixels that show a floor or a step of stairs, also through glass; a person on it is not floor."""
    return np.asarray(np.isin(view.surface, scene.floor_surfaces))


def transient_mask(scene: Scene, view: View) -> NDArray[np.bool_]:
    """(H, W) bool: pixels that show a person."""
    return np.asarray(view.surface >= scene.first_person)


def normals(scene: Scene, view: View) -> NDArray[np.float32]:
    """(H, W, 3) unit world normals toward the camera; zero on people."""
    table = np.array([normal(s, len(scene.boxes)) for s in range(scene.first_person)] + [(0.0, 0.0, 0.0)])
    return np.asarray(table[np.minimum(view.surface, scene.first_person)], np.float32)
