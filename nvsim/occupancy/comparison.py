"""A map against a true one, cell by cell of the true one."""

from __future__ import annotations

from typing import Any

import numpy as np

from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

_NAMES = {"free": FREE, "occupied": OCCUPIED, "unknown": UNKNOWN}


def compare_maps(found: OccupancyMap, true: OccupancyMap) -> dict[str, Any]:
    """Figures of `found` at the middles of the cells of `true`, both in one frame.

    free_found_free, _occupied, _unknown      shares of the truly free cells that are found so; None of none
    occupied_found_free, _occupied, _unknown  the same of those truly occupied: the first should be 0, as it leads
                                              into things; insides of walls are unknown to every sensor
    free_cells, occupied_cells                how many there are
    beside_m2                                 square metres of `found` that are free and where `true` knows nothing
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
