"""Renders what an agent sees at a viewpoint, as an image for a request."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from nvsim.endpoint.request import Image
from nvsim.graph.connectivity import scan_files
from nvsim.r2r.observations.layout import jpeg
from nvsim.r2r.prompted.looking import Looking
from nvsim.r2r.simulator.images import View
from nvsim.r2r.simulator.settings import Settings
from nvsim.r2r.simulator.source import source_of

QUALITY = 85
"""JPEG quality."""


class ViewRenderer:
    """Renders views from the skyboxes of an exported folder, or live from the models of a project. Thread-safe.

    Raises InputError if the folder does not exist or contains neither.
    """

    def __init__(self, place: Path, looking: Looking) -> None:
        settings = Settings()
        settings.setDatasetPath(place)
        if not (place / "project.db").is_file():
            settings.setNavGraphPath(next(iter(scan_files(place).values())).parent)
        self._scans, self._images = source_of(settings)
        self._view = View(looking.image_width, looking.image_height, math.radians(looking.field_of_view), False)

    def see(self, scan: str, viewpoint: str, heading: float, elevation: float = 0.0) -> Image:
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
