"""Where an agent goes and what it sees there: directions to viewpoints in words, and views as images for a request."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nvsim.endpoint.request import Image
from nvsim.geometry.directions import STEP
from nvsim.graph.connectivity import scan_files
from nvsim.graph.types import NavGraph
from nvsim.r2r.instructions.ground import Leg, Slope, rounded_turn, wrap_angle
from nvsim.r2r.observations.layout import jpeg
from nvsim.r2r.prompted.options import ImageOptions
from nvsim.r2r.simulator.images import ViewSize
from nvsim.r2r.simulator.settings import Settings, source_of

_STEEP = math.radians(14)  # 0.25 m per meter, as for the instructions
_TURNS = {"ahead": "go straight ahead"}
QUALITY = 85
"""JPEG quality."""


@dataclass(frozen=True)
class Bearing:
    """Direction and distance to a viewpoint.

    heading    radians, 0 is +y, positive turns right; None straight up or down
    elevation  radians above the horizon
    meters     length of the straight line in meters
    """

    heading: float | None
    elevation: float
    meters: float

    @property
    def slope(self) -> Slope:
        return "level" if abs(self.elevation) <= _STEEP else "up" if self.elevation > 0 else "down"

    def turn_from(self, facing: float) -> float:
        """Returns the turn in radians from the heading `facing`, positive to the right, in (-pi, pi]."""
        return 0.0 if self.heading is None else wrap_angle(self.heading - facing)

    def describe(self, facing: float) -> str:
        """Describes the move for an agent with heading `facing` (radians): "turn slightly right and go 2.4 m, up"."""
        turn = rounded_turn(Leg(self.turn_from(facing), self.meters, self.slope))
        slope = "" if self.slope == "level" else f", {self.slope}"
        return f"{_TURNS.get(turn, f'turn {turn} and go')} {self.meters:.1f} m{slope}"


def bearing(graph: NavGraph, start: str, stop: str) -> Bearing:
    """Returns the direction and distance from viewpoint `start` to viewpoint `stop`."""
    x, y, z = (b - a for a, b in zip(graph.viewpoints[start].position, graph.viewpoints[stop].position, strict=True))
    level = math.hypot(x, y)
    return Bearing(math.atan2(x, y) if level > 1e-6 else None, math.atan2(z, level), math.hypot(level, z))


def level(elevation: float) -> float:
    """Limits an elevation in radians to one step of the simulator's views."""
    return max(-STEP, min(STEP, elevation))


class ViewRenderer:
    """Renders views from the skyboxes of an exported folder, or live from the models of a project. Thread-safe.

    Raises InputError if the folder does not exist or contains neither.
    """

    def __init__(self, place: Path, looking: ImageOptions) -> None:
        settings = Settings()
        settings.setDatasetPath(place)
        if not (place / "project.db").is_file():
            settings.setNavGraphPath(next(iter(scan_files(place).values())).parent)
        self._scans, self._images = source_of(settings)
        self._view = ViewSize(looking.image_width, looking.image_height, math.radians(looking.field_of_view), False)

    def view(self, scan: str, viewpoint: str, heading: float, elevation: float = 0.0) -> Image:
        """Returns the view at a viewpoint, with angles in radians.

        The angles are rounded to 0.1 degrees, so that equal views give equal images. Raises InputError if the viewpoint
        does not exist or its images are unusable.
        """
        found = self._scans.scan(scan)
        degrees = round(math.degrees(heading) % 360, 1) % 360, round(math.degrees(elevation), 1)
        rgb, _ = self._images.draw(
            found, found.index(viewpoint), math.radians(degrees[0]), math.radians(degrees[1]), self._view
        )
        data = jpeg(np.ascontiguousarray(rgb[..., ::-1]), QUALITY, whole_chroma=False)
        name = f"{scan} {viewpoint}, heading {degrees[0]:g}, elevation {degrees[1]:g}"
        return Image(name, data, self._view.width, self._view.height)

    def close(self) -> None:
        self._images.close()
