"""What one sees who stands at a viewpoint and looks somewhere, as an image that can be sent."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from nvsim.endpoint.request import Image
from nvsim.graph.connectivity import scan_files
from nvsim.r2r.observations.encoding import jpeg
from nvsim.r2r.prompted.looking import Looking
from nvsim.r2r.simulator.images import View
from nvsim.r2r.simulator.settings import Settings
from nvsim.r2r.simulator.source import source_of

QUALITY = 85
"""Of JPEG."""


class Eyes:
    """Draws views from the skyboxes of an exported folder, or live from the models of a project. May be asked by
    several threads. Raises InputError where there is no such folder or nothing to draw from."""

    def __init__(self, place: Path, looking: Looking) -> None:
        settings = Settings()
        settings.setDatasetPath(place)
        if not (place / "project.db").is_file():
            settings.setNavGraphPath(next(iter(scan_files(place).values())).parent)
        self._scans, self._images = source_of(settings)
        self._view = View(looking.image_width, looking.image_height, math.radians(looking.field_of_view), False)

    def see(self, scan: str, viewpoint: str, heading: float, elevation: float = 0.0) -> Image:
        """The view, angles in radians, rounded to a tenth of a degree so that equal views are equal images. Raises
        InputError where the viewpoint is not there or its images cannot be used."""
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
