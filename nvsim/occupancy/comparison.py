"""Compare an occupancy map with a ground truth map, cell by cell."""

from __future__ import annotations

from typing import Any

import numpy as np

from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

_NAMES = {"free": FREE, "occupied": OCCUPIED, "unknown": UNKNOWN}


def compare_maps(found: OccupancyMap, true: OccupancyMap) -> dict[str, Any]:
    """Metrics of `found` at the centers of the cells of `true`. Both maps must be in one frame.

    free_found_free, _occupied, _unknown      shares of the truly free cells with each state in `found`; None without
                                              free cells
    occupied_found_free, _occupied, _unknown  shares of the truly occupied cells; the first should be 0, because such
                                              cells lead into obstacles; insides of walls are unknown to every sensor
    free_cells, occupied_cells                numbers of truly free and occupied cells
    beside_m2                                 square meters that are free in `found` and unknown in `true`
    """
    at = found.at(true.centres())
    figures: dict[str, Any] = {}
    for name in ("free", "occupied"):
        chosen = at[true.cells == _NAMES[name]]
        for what, state in _NAMES.items():
            figures[f"{name}_found_{what}"] = round(float((chosen == state).mean()), 4) if len(chosen) else None
        figures[f"{name}_cells"] = len(chosen)
    beside = (found.cells == FREE) & (true.at(found.centres()) == UNKNOWN)
    figures["beside_m2"] = round(float(np.count_nonzero(beside)) * found.resolution**2, 2)
    return figures
