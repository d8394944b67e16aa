"""The floor under a viewpoint is that of its own storey."""

from __future__ import annotations

import math

import numpy as np
import pytest

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.project.floor_heights import floor_beneath
from nvsim.submaps.types import Submap


class House:
    """Two storeys over one another, a submap each, and a shed whose floor nobody estimated."""

    def submaps(self, of: str = "submaps") -> list[Submap]:
        places = np.column_stack([np.arange(5.0), np.zeros(5), np.full(5, 1.5)])
        shifts = ([0, 0, 0], [0, 0, 3], [20, 0, 0])
        return [Submap(i, tuple(range(5)), tuple(range(5)), places + shift) for i, shift in enumerate(shifts)]

    def surface(self, submap: int) -> FloorSurface | None:
        return None if submap == 2 else FloorSurface.flat(3.0 * submap)


def test_storeys_stay_apart_and_far_from_the_walk_nothing_is_known() -> None:
    floor = floor_beneath(House())  # type: ignore[arg-type]
    assert floor is not None
    assert floor(2.2, 0.1, 1.4) == 0.0 and floor(2.2, 0.1, 4.4) == 3.0
    assert math.isnan(floor(60.0, 0.0, 1.5))


def test_without_an_estimated_floor_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(House, "surface", lambda self, submap: None)
    assert floor_beneath(House()) is None  # type: ignore[arg-type]
