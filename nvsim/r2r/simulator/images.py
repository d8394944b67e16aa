"""The sources of a simulator's images: the skybox strips of a dataset, or the models of a project."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.simulator.conventions import InvalidValue
from nvsim.r2r.simulator.scan import Scan, Scans
from nvsim.r2r.simulator.skybox import StripCache, rays_of

try:
    from nvsim.r2r.simulator.compiled_drawing import draw_colours, draw_depth
except ModuleNotFoundError:  # the package nvsim-mattersim has no numba
    from nvsim.r2r.simulator.plain_drawing import draw_colours, draw_depth  # type: ignore[assignment]


@dataclass(frozen=True)
class View:
    """The size of a view: width and height in pixels, vertical field of view in radians, and whether it has depth."""

    width: int
    height: int
    vfov: float
    depth: bool


@dataclass(frozen=True)
class Goal:
    """The target of a move: x, y, z in meters, world. If z is None, the height above the floor is unchanged.

    straight   whether the straight way to it must be free, or only the position itself
    """

    x: float
    y: float
    z: float | None
    straight: bool


if TYPE_CHECKING:
    Drawn = tuple[NDArray[np.uint8], NDArray[np.uint16] | None]
    """(height, width, 3) BGR, and (height, width, 1) depth along the optical axis in 0.25 mm."""


_ALONE = "A skybox dataset has images only at its viewpoints; give setDatasetPath a project to move elsewhere."


class Images(Protocol):
    """Draws the views of a simulator. Several threads may call it.

    one_thread_each   whether a view uses one thread, so that several views are drawn in parallel
    """

    one_thread_each: bool

    def draw(self, scan: Scan, index: int, heading: float, elevation: float, view: View) -> Drawn:
        """Returns the view from a viewpoint; angles in radians. Raises InvalidValue if its images are unusable."""

    def draw_from(self, position: NDArray[np.float64], heading: float, elevation: float, view: View) -> Drawn:
        """Returns the view from a position (3,), meters. Raises InvalidValue if there are only viewpoint images."""

    def preload(self, scans: Scans, depth: bool) -> None:
        """Loads all images or models."""

    def stand(self, here: NDArray[np.float64], goal: Goal) -> NDArray[np.float64]:
        """Returns the camera position (3,), meters, after a move from `here` (3,) to `goal`.

        Raises InvalidValue with the reason if the move is not possible.
        """

    def reachable(self, place: NDArray[np.float64], scan: Scan) -> list[int]:
        """Returns the indices of the viewpoints near a position (3,), meters, to which the way is free."""

    def close(self) -> None:
        """Releases all images or models."""


class StripImages:
    """Views from the skybox strips in the folder of a dataset."""

    one_thread_each = True

    def __init__(self, folder: Path | str, cache_size: int) -> None:
        self.cache = StripCache(folder, cache_size)

    def draw(self, scan: Scan, index: int, heading: float, elevation: float, view: View) -> Drawn:
        id = scan.ids[index]
        strip = self.cache.colours(scan.id, id)
        rays, plane = rays_of(scan.rotation[index], heading, elevation, view.width, view.height, view.vfov)
        rgb = np.empty((view.height, view.width, 3), np.uint8)
        draw_colours(strip, rays, rgb)
        if not view.depth:
            return rgb, None
        depth = np.empty((view.height, view.width, 1), np.uint16)
        draw_depth(self.cache.distances(scan.id, id), rays, plane, depth)
        return rgb, depth

    def draw_from(self, position: NDArray[np.float64], heading: float, elevation: float, view: View) -> Drawn:
        """Raises InvalidValue for every position (3,), because there are only images of viewpoints."""
        raise InvalidValue(_ALONE)

    def preload(self, scans: Scans, depth: bool) -> None:
        for id in scans.scan_ids():
            scan = scans.scan(id)
            for viewpoint, included in zip(scan.ids, scan.included.tolist()):
                if included:
                    self.cache.preload(id, viewpoint, depth)

    def stand(self, here: NDArray[np.float64], goal: Goal) -> NDArray[np.float64]:
        """Raises InvalidValue for every position `here` (3,), because there are only images of viewpoints."""
        raise InvalidValue(_ALONE)

    def reachable(self, place: NDArray[np.float64], scan: Scan) -> list[int]:
        """Returns an empty list for every position (3,), because free space is unknown."""
        return []

    def close(self) -> None:
        pass


def draw_all(images: Images, wanted: Sequence[Callable[[], Drawn]]) -> list[Drawn]:
    """Draws views in sequence, or in parallel threads if `one_thread_each` is true."""
    if len(wanted) == 1 or not images.one_thread_each:
        return [draw() for draw in wanted]
    return list(_threads().map(lambda draw: draw(), wanted))


@lru_cache(maxsize=None)  # noqa: UP033 (Python 3.8)
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(
        os.process_cpu_count() if hasattr(os, "process_cpu_count") else os.cpu_count(), "nvsim-view"
    )
