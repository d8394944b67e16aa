"""Where a simulator has its images from: the skybox strips of a data set, or the splats of a project."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.simulator.cubemap import draw_colours, draw_depth, rays_of
from nvsim.r2r.simulator.errors import InvalidValue
from nvsim.r2r.simulator.nav_graph import Scans
from nvsim.r2r.simulator.scan import Scan
from nvsim.r2r.simulator.skybox import StripCache


@dataclass(frozen=True)
class View:
    """width, height in pixels, vfov in radians. depth: whether it is wanted too."""

    width: int
    height: int
    vfov: float
    depth: bool


@dataclass(frozen=True)
class Goal:
    """x, y, z in metres, world; without z as high above the floor as one is. straight: whether the straight way to it
    must be free, or only the place itself."""

    x: float
    y: float
    z: float | None
    straight: bool


Drawn = tuple[NDArray[np.uint8], NDArray[np.uint16] | None]
"""(height, width, 3) blue, green, red, and (height, width, 1) depth along the optical axis in 0.25 mm."""


_ALONE = "A data set of skyboxes has its viewpoints alone; give setDatasetPath a project to stand elsewhere."


class Images(Protocol):
    """What draws the views of a simulator; asked from several threads at once.

    one_thread_each   whether a view takes one thread, so that several are best drawn at once
    """

    one_thread_each: bool

    def draw(self, scan: Scan, index: int, heading: float, elevation: float, view: View) -> Drawn:
        """The view from a viewpoint. Raises InvalidValue where its images cannot be used."""

    def draw_from(self, position: NDArray[np.float64], heading: float, elevation: float, view: View) -> Drawn:
        """The view from any place (3,). Raises InvalidValue where there are images of viewpoints alone."""

    def preload(self, scans: Scans, depth: bool) -> None:
        """Loads all there is."""

    def stand(self, here: NDArray[np.float64], goal: Goal) -> NDArray[np.float64]:
        """(3,) where one stands who went from `here` (3,) to `goal`. Raises InvalidValue with the reason where that
        cannot be."""

    def reachable(self, place: NDArray[np.float64], scan: Scan) -> list[int]:
        """The indices of the viewpoints near a place (3,) that the way to is free."""

    def close(self) -> None:
        """Lets go of what it holds."""


class StripImages:
    """Views out of the skybox strips under a data set's folder."""

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
        raise InvalidValue(_ALONE)

    def preload(self, scans: Scans, depth: bool) -> None:
        for id in scans.scan_ids():
            scan = scans.scan(id)
            for viewpoint, included in zip(scan.ids, scan.included.tolist(), strict=True):
                if included:
                    self.cache.preload(id, viewpoint, depth)

    def stand(self, here: NDArray[np.float64], goal: Goal) -> NDArray[np.float64]:
        raise InvalidValue(_ALONE)

    def reachable(self, place: NDArray[np.float64], scan: Scan) -> list[int]:
        return []

    def close(self) -> None:
        pass


def draw_all(images: Images, wanted: Sequence[Callable[[], Drawn]]) -> list[Drawn]:
    """The views one after the other, or on several threads where the images are drawn by one each."""
    if len(wanted) == 1 or not images.one_thread_each:
        return [draw() for draw in wanted]
    return list(_threads().map(lambda draw: draw(), wanted))


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(
        os.process_cpu_count() if hasattr(os, "process_cpu_count") else os.cpu_count(), "nvsim-view"
    )
