"""The options of the built-in building."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nvsim.errors import InputError

SMALLEST_HALLS, LARGEST_HALLS = 250, 20000
"""Square metres of a building of halls."""

Style = Literal["furnished", "glass", "bare"]
"""glass: partitions and screens of glass, through which the scanner looks. bare: plain walls, little furniture."""


@dataclass(frozen=True)
class BuildingConfig:
    """seed decides plan, furniture, colours and people. "full" is about 300 m2 with at least six rooms around a loop
    of corridors, "small" two rooms and a door; with two storeys each of them has as much, and a stair joins them.
    "halls" has `area` square metres of shops along wide halls, on one storey. Image size in pixels; the horizontal
    field of view in degrees. Raises InputError for an area that no such building has."""

    seed: int = 0
    size: Literal["full", "small", "halls"] = "full"
    width: int = 480
    height: int = 360
    horizontal_fov: float = 80.0
    step: float = 0.4  # metres between images on a straight line
    turn: float = 16.0  # degrees between images while turning
    people: bool = True
    storeys: Literal[1, 2] = 1
    style: Style = "furnished"
    area: int = 0

    def __post_init__(self) -> None:
        if self.size != "halls":
            return
        if not SMALLEST_HALLS <= self.area <= LARGEST_HALLS:
            reach = f"{SMALLEST_HALLS} to {LARGEST_HALLS}"
            raise InputError(f"A building of halls has {reach} square metres, not {self.area}; choose another --area.")
        if self.storeys != 1:
            raise InputError("A building of halls has one storey; leave --storeys out, or --area.")
