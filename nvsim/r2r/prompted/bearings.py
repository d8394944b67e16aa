"""Which way and how far one viewpoint lies from another, in radians, metres and words."""

from __future__ import annotations

import math
from dataclasses import dataclass

from nvsim.geometry.view_sweep import STEP
from nvsim.graph.types import NavGraph
from nvsim.r2r.instructions.ground import Leg, Slope, wrapped
from nvsim.r2r.instructions.rounding import turn_of

_STEEP = math.radians(14)  # 0.25 m a metre, as instructions have it
_TURNS = {"ahead": "go straight ahead"}


@dataclass(frozen=True)
class Bearing:
    """heading    radians, 0 is +y, positive turns right; None straight up or down
    elevation  radians above the horizon
    metres     of the straight line
    """

    heading: float | None
    elevation: float
    metres: float

    @property
    def slope(self) -> Slope:
        return "level" if abs(self.elevation) <= _STEEP else "up" if self.elevation > 0 else "down"

    def turn(self, facing: float) -> float:
        """Radians from where one looks, positive to the right, in (-pi, pi]."""
        return 0.0 if self.heading is None else wrapped(self.heading - facing)

    def words(self, facing: float) -> str:
        """How one who looks to `facing` gets there: "turn slightly right and go 2.4 m, up"."""
        turn = turn_of(Leg(self.turn(facing), self.metres, self.slope))
        slope = "" if self.slope == "level" else f", {self.slope}"
        return f"{_TURNS.get(turn, f'turn {turn} and go')} {self.metres:.1f} m{slope}"


def bearing(graph: NavGraph, start: str, stop: str) -> Bearing:
    """Where `stop` lies, seen from `start`."""
    x, y, z = (b - a for a, b in zip(graph.viewpoints[start].position, graph.viewpoints[stop].position, strict=True))
    level = math.hypot(x, y)
    return Bearing(math.atan2(x, y) if level > 1e-6 else None, math.atan2(z, level), math.hypot(level, z))


def level(elevation: float) -> float:
    """How far up or down one looks who goes there, radians: no farther than the simulator's views."""
    return max(-STEP, min(STEP, elevation))
