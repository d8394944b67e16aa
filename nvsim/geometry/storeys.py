"""The storeys of a building, from the heights of viewpoints or cameras.

Many equal heights indicate a floor. Stairs and landings between two floors belong to both storeys."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

APART = 1.8  # meters between two floors, at least: a door and the structure above it
BAND = 0.5  # meters by which a floor may rise and fall within a storey
FEW = 3  # viewpoints that make a floor, at least
SHARE = 0.03  # of all viewpoints that make a floor, at least
_BIN = 0.1  # meters


@dataclass(frozen=True)
class Storey:
    """floor      meters, world z, of most of the storey
    low, high  heights between these values belong to the storey; storeys overlap at stairs
    count      viewpoints that are nearest to this floor
    """

    floor: float
    low: float
    high: float
    count: int

    def contains_floors(self, floors: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) bool, True for heights `floors` (N,) in meters, world z, that belong to the storey."""
        return (floors > self.low) & (floors < self.high)


def storeys(floors: NDArray[np.float64]) -> tuple[Storey, ...]:
    """The storeys, lowest first; empty without viewpoints. `floors` (N,) is the floor height beneath each viewpoint,
    meters, world z."""
    if not len(floors):
        return ()
    heights = _floors(floors)
    nearest = _nearest(floors, heights)
    lows = [-math.inf, *(h + BAND for h in heights[:-1])]
    highs = [*(h - BAND for h in heights[1:]), math.inf]
    return tuple(
        Storey(h, low, high, int((nearest == i).sum()))
        for i, (h, low, high) in enumerate(zip(heights, lows, highs, strict=True))
    )


def storey_numbers(floors: NDArray[np.float64]) -> NDArray[np.int64]:
    """(N,) int64 number of the storey whose floor is nearest to each of the heights (N,), meters; the lowest is 1."""
    return _nearest(floors, _floors(floors)) + 1 if len(floors) else np.zeros(0, np.int64)


def _nearest(floors: NDArray[np.float64], heights: list[float]) -> NDArray[np.int64]:
    return np.asarray(np.abs(floors[:, None] - np.array(heights)).argmin(axis=1), np.int64)


def _floors(floors: NDArray[np.float64]) -> list[float]:
    """Heights of floors, ascending. The heights with the most viewpoints are chosen first, at a distance of APART."""
    start = float(floors.min()) - 1.0
    counts = np.bincount(((floors - start) / _BIN).astype(int)).astype(np.float64)
    reach = np.arange(-10, 11) * _BIN
    density = np.convolve(counts, np.exp(-0.5 * (reach / 0.25) ** 2))[10 : 10 + len(counts)]
    places = start + (np.arange(len(counts)) + 0.5) * _BIN
    least = max(FEW, SHARE * len(floors))
    found: list[float] = []
    while density.max() > 0:
        peak, reach_of_floor = float(places[density.argmax()]), _BIN
        around = np.abs(floors - peak) < BAND
        if around.sum() >= least:
            peak, reach_of_floor = float(np.median(floors[around])), APART
            found.append(peak)
        density[np.abs(places - peak) < reach_of_floor] = 0.0
    return sorted(found) or [float(np.median(floors))]
