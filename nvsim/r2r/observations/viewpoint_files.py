"""Draws and encodes all images of one viewpoint."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.view_sweep import sweep
from nvsim.graph.types import Viewpoint
from nvsim.r2r.observations.encoding import jpeg, png
from nvsim.r2r.observations.places import ScanPlaces
from nvsim.r2r.observations.settings import ScanSettings
from nvsim.r2r.observations.skybox import Skybox, as_bytes, focal_of, skybox_of
from nvsim.r2r.observations.surround import Surround, draw_surround
from nvsim.render.backends import Backend
from nvsim.splats.types import SubmapModel


@dataclass(frozen=True, eq=False)
class Images:
    """The images of a viewpoint: its strips, and the 36 views (480, 640, 3) uint8, empty if they are not exported."""

    skybox: Skybox
    views: list[NDArray[np.uint8]]


class Painter:
    """Draws viewpoints one after another and reuses their memory."""

    def __init__(self, settings: ScanSettings, backend: Backend) -> None:
        self._settings, self._backend = settings, backend
        self._last: Surround | None = None

    def draw(self, model: SubmapModel, viewpoint: Viewpoint) -> Images:
        """Draws the images of a viewpoint of `model`. Raises InputError if the backend is not available."""
        at, size = np.array(viewpoint.position), self._settings.size
        surround = self._last = draw_surround(model, at, focal_of(size), self._backend, self._last)
        views = [as_bytes(surround.colour(camera)) for camera in sweep(at)] if self._settings.views else []
        return Images(skybox_of(surround, model.floor, size), views)


def encode_images(
    images: Images, viewpoint: Viewpoint, settings: ScanSettings, places: ScanPlaces
) -> list[tuple[Path, bytes]]:
    """Returns paths and contents of the image files."""
    skybox, id = images.skybox, viewpoint.id
    files = [
        (places.strip(id), jpeg(skybox.colour, settings.quality, whole_chroma=True)),
        (places.depth(id), png(skybox.depth)),
    ]
    if settings.faces:
        for path, face in zip(places.faces(id), skybox.faces, strict=True):
            files.append((path, jpeg(face, settings.quality, whole_chroma=True)))
    for path, view in zip(places.sweep(id), images.views, strict=False):
        files.append((path, jpeg(view, settings.quality, whole_chroma=False)))
    return files
