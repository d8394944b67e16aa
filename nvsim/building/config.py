"""The options of the built-in building."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Style = Literal["furnished", "glass", "bare"]
"""glass: partitions and screens of glass, through which the scanner looks. bare: plain walls, little furniture."""


@dataclass(frozen=True)
class BuildingConfig:
    """seed decides plan, furniture, colours and people. "full" is about 300 m2 with at least six rooms around a loop
    of corridors, "small" two rooms and a door; with two storeys each of them has as much, and a stair joins them. Image
    size in pixels; the horizontal field of view in degrees."""

    seed: int = 0
    size: Literal["full", "small"] = "full"
    width: int = 480
    height: int = 360
    horizontal_fov: float = 80.0
    step: float = 0.4  # metres between images on a straight line
    turn: float = 16.0  # degrees between images while turning
    people: bool = True
    storeys: Literal[1, 2] = 1
    style: Style = "furnished"
