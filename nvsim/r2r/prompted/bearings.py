"""Direction and distance from one viewpoint to another, in radians, meters and words."""

from __future__ import annotations

import math
from dataclasses import dataclass

from nvsim.geometry.view_sweep import STEP
from nvsim.graph.types import NavGraph
from nvsim.r2r.instructions.ground import Leg, Slope, turn_of, wrapped

_STEEP = math.radians(14)  # 0.25 m per meter, as for the instructions
_TURNS = {"ahead": "go straight ahead"}


@dataclass(frozen=True)
class Bearing:
    """Direction and distance to a viewpoint.

    heading    radians, 0 is +y, positive turns right; None straight up or down
    elevation  radians above the horizon
    metres     length of the straight line in meters
    """

    heading: float | None
    elevation: float
    metres: float

    @property
    def slope(self) -> Slope:
        return "level" if abs(self.elevation) <= _STEEP else "up" if self.elevation > 0 else "down"

    def turn(self, facing: float) -> float:
        """Returns the turn in radians from the heading `facing`, positive to the right, in (-pi, pi]."""
        return 0.0 if self.heading is None else wrapped(self.heading - facing)

    def words(self, facing: float) -> str:
        """Describes the move for an agent with heading `facing` (radians): "turn slightly right and go 2.4 m, up"."""
        turn = turn_of(Leg(self.turn(facing), self.metres, self.slope))
        slope = "" if self.slope == "level" else f", {self.slope}"
        return f"{_TURNS.get(turn, f'turn {turn} and go')} {self.metres:.1f} m{slope}"


def bearing(graph: NavGraph, start: str, stop: str) -> Bearing:
    """Returns the direction and distance from viewpoint `start` to viewpoint `stop`."""
    x, y, z = (b - a for a, b in zip(graph.viewpoints[start].position, graph.viewpoints[stop].position, strict=True))
    level = math.hypot(x, y)
    return Bearing(math.atan2(x, y) if level > 1e-6 else None, math.atan2(z, level), math.hypot(level, z))


def level(elevation: float) -> float:
    """Limits an elevation in radians to one step of the simulator's views."""
    return max(-STEP, min(STEP, elevation))
