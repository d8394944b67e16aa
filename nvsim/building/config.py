"""The options of the built-in building."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nvsim.errors import InputError

SMALLEST_HALLS, LARGEST_HALLS = 250, 20000
"""Least and greatest area of a building of halls, square meters."""

Style = Literal["furnished", "glass", "bare"]
"""glass: partitions and screens of glass, which the scanner sees through. bare: plain walls, little furniture."""


@dataclass(frozen=True)
class BuildingConfig:
    """Options of the built-in building. `seed` decides plan, furniture, colors, and people. The size "full" has about
    300 m2 with at least six rooms around a loop of corridors; "small" has two rooms and a door. The size "halls" has
    `area` square meters of shops along wide halls, on one storey. With two storeys, each has the full size, and stairs
    join them. The image size is in pixels, the horizontal field of view in degrees. Raises InputError for an invalid
    area or a second storey of halls."""

    seed: int = 0
    size: Literal["full", "small", "halls"] = "full"
    width: int = 480
    height: int = 360
    horizontal_fov: float = 80.0
    step: float = 0.4  # meters between images on a straight line
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
            raise InputError(f"A building of halls has {reach} square meters, not {self.area}; choose another --area.")
        if self.storeys != 1:
            raise InputError("A building of halls has one storey; remove --storeys or --area.")
