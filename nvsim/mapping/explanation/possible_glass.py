"""Tell where a glass pane, or a wall without texture, may be. Photographs and depth images do not show them, so the
corridor through one looks free; but the trajectory goes around it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from nvsim.mapping.explanation.seen_floor import SeenFloor
from nvsim.mapping.explanation.trajectory_detour import Camera, TrajectoryDetour
from nvsim.mapping.explanation.wall_openings import WallOpenings


@dataclass(frozen=True)
class PossibleGlass:
    """detour    the detours of the trajectory
    openings  the openings of the walls; None if no cloud shows the walls
    seen      the floor that images show; None if they have no depth
    """

    detour: TrajectoryDetour
    openings: WallOpenings | None = None
    seen: SeenFloor | None = None

    def reason(self, a: Camera, b: Camera) -> str:
        """Return a clause, without its subject, why a pane may be on the line between two cameras (x, y, z). "" if none
        may be there.

        A pane may be in an opening of a wall that the trajectory does not pass through, if it passes through a door in
        the same wall, or makes a long detour around the opening. A detour without an opening counts unless images show
        one side of the line from the other."""
        if self.openings is not None and self.openings.leads_through_unused(a, b, beside_door=True):
            return "passes through a wall beside a door, and the trajectory uses only the door"
        meters = self.detour(a, b)
        if not meters or self._is_open(a, b):
            return ""
        return f"skips {f'{meters:.0f} m' if math.isfinite(meters) else 'a long part'} of the trajectory"

    def _is_open(self, a: Camera, b: Camera) -> bool:
        if self.openings is None or self.openings.leads_through_unused(a, b, beside_door=False):
            return False
        return self.seen is not None and self.seen.is_seen_across(a, b)
