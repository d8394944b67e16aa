"""Measures the time of panoramas: the views of a traversability check, six cube faces, one equirectangular image."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.benchmarks.map_builder import HALL, hall
from nvsim.geometry.directions import cube
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import Corridor, HeightAt, headings, offset_ahead
from nvsim.mapping.views.floor_view import pixels_read
from nvsim.mapping.views.view_sources import camera_towards
from nvsim.render.backends import Backend, resolve_backend
from nvsim.render.model import render_model
from nvsim.render.panorama import render_equirectangular
from nvsim.render.scene import model_of, render_regions
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import Background, FloorTexture, SubmapModel

_CHANNELS = frozenset({"rgb", "alpha", "normal"})
_FACE, _WIDTH, _HEIGHT = 512, 1024, 512  # pixels


def furnished_hall() -> tuple[SubmapModel, NDArray[np.float64]]:
    """A generated hall and eight positions in it, (8, 3) float64 in meters, for measurements without a project. It has
    Gaussians of SH degree 3, a background network and a floor texture."""
    r, f = np.random.default_rng(1), np.float32
    model = hall()
    sh = r.normal(0, 0.15, (len(model.gaussians), 16, 3)).astype(f)
    sizes = {"embed.0": (32, 27), "embed.1": (16, 32), "trunk.0": (64, 16), "trunk.1": (64, 64)}
    sizes |= {"base": (3, 64), "rest": (72, 64)}
    weights = {f"{n}.weight": (r.normal(size=s) / np.sqrt(s[1])).astype(f) for n, s in sizes.items()}
    weights |= {f"{n}.bias": np.zeros(s[0], f) for n, s in sizes.items()}
    levels = tuple(r.normal(0, 0.1, (round(HALL[1] / t), round(HALL[0] / t), 3)).astype(f) for t in (0.4, 0.1, 0.03))
    model = replace(
        model,
        gaussians=replace(model.gaussians, sh=sh),
        background=Background(weights),
        texture=FloorTexture(levels, (0.0, 0.0), HALL),
    )
    x, y = np.meshgrid((1.5, 5.0, 8.3, 12.0), (1.5, 7.4))
    return model, np.stack([x.ravel(), y.ravel(), np.full(8, 1.3)], axis=1)


def measure(
    scene: SceneModel | SubmapModel,
    places: NDArray[np.floating],
    floor_at: HeightAt,
    rounds: int = 5,
    backend: Backend = "auto",
) -> dict[str, Any]:
    """Rendering times in milliseconds: the median over `rounds` of the mean over `places`, (n, 3) in meters, world.

    traversability_ms    rgb, alpha and normals of the map builder's eight views
    cube_ms              these channels of six faces of 512 pixels
    equirectangular_ms   these channels of 1024 x 512 pixels
    wanted_of_...        share of the pixels in the regions

    Each is measured for all pixels, and for the regions that the eight corridors of a viewpoint occupy. The names with
    all pixels are traversability_whole_ms, cube_ms and equirectangular_ms. The names with regions are
    traversability_ms, cube_regions_ms and equirectangular_regions_ms. The variants take turns, so that other load on
    the machine affects all of them equally.

    Raises InputError if the files of a submap cannot be read or the backend cannot run on this machine.
    """
    views = [_PositionViews(scene, place, floor_at, backend) for place in places]
    parts: dict[str, Callable[[_PositionViews], object]] = {
        "traversability_ms": lambda v: v.look_down(regions=True),
        "traversability_whole_ms": lambda v: v.look_down(regions=False),
        "cube_regions_ms": lambda v: v.cube(regions=True),
        "cube_ms": lambda v: v.cube(regions=False),
        "equirectangular_regions_ms": lambda v: v.equirectangular(regions=True),
        "equirectangular_ms": lambda v: v.equirectangular(regions=False),
    }
    seconds: dict[str, list[float]] = {name: [] for name in parts}
    for part in parts.values():
        part(views[0])  # compiles
    for _ in range(rounds):
        for name, part in parts.items():
            begin = time.perf_counter()
            for view in views:
                part(view)
            seconds[name].append((time.perf_counter() - begin) / len(views))
    counts = [len(model_of(scene, place).gaussians) for place in places]
    return {
        **{name: round(1e3 * float(np.median(s)), 1) for name, s in seconds.items()},
        "backend": resolve_backend(backend),
        "gaussians": round(float(np.mean(counts))),
        "places": len(places),
        "view_size": MappingConfig().view_size,
        "wanted_of_views": round(float(np.mean([np.mean(v.masks) for v in views])), 3),
        "wanted_of_cube": round(float(np.mean([np.mean(v.face_masks) for v in views])), 3),
        "wanted_of_equirectangular": round(float(np.mean([v.mask.mean() for v in views])), 3),
    }


class _PositionViews:
    """The views from one position. Their masks are computed before the measurement."""

    def __init__(
        self, scene: SceneModel | SubmapModel, place: NDArray[np.floating], floor_at: HeightAt, backend: Backend
    ) -> None:
        config = MappingConfig()
        self._scene, self._place, self._backend = scene, np.asarray(place, np.float64), backend
        xy = self._place[:2]
        eye = float(self._place[2])
        corridors = [
            Corridor((xy[0], xy[1]), tuple(xy + offset_ahead(h, config.tau_dist)), eye) for h in headings(config)
        ]
        self._cameras = [camera_towards(self._place, h, config) for h in headings(config)]
        self.masks = [pixels_read(camera, [c], floor_at) for camera, c in zip(self._cameras, corridors, strict=True)]
        self._faces = cube(self._place, _FACE)
        height = float(self._place[2] - floor_at(self._place))
        self.face_masks = [_on_corridors(camera.rays(), xy, height, corridors) for camera in self._faces]
        heading = ((np.arange(_WIDTH) + 0.5) / _WIDTH - 0.5) * 2 * np.pi
        elevation = (0.5 - (np.arange(_HEIGHT) + 0.5) / _HEIGHT)[:, None] * np.pi
        flat = np.cos(elevation)
        rays = np.stack(np.broadcast_arrays(flat * np.sin(heading), flat * np.cos(heading), np.sin(elevation)), axis=-1)
        self.mask = _on_corridors(rays, xy, height, corridors)

    def look_down(self, regions: bool) -> None:
        self._draw(self._cameras, self.masks if regions else None)

    def cube(self, regions: bool) -> None:
        self._draw(self._faces, self.face_masks if regions else None)

    def equirectangular(self, regions: bool) -> None:
        mask = self.mask if regions else None
        size = (_WIDTH, _HEIGHT)
        render_equirectangular(self._scene, self._place, *size, _CHANNELS, backend=self._backend, mask=mask)

    def _draw(self, cameras: list[Any], masks: list[NDArray[np.bool_]] | None) -> None:
        if masks is not None:
            render_regions(self._scene, cameras, masks, _CHANNELS, self._backend)
            return
        model = model_of(self._scene, self._place)
        for camera in cameras:
            render_model(model, camera, _CHANNELS, backend=self._backend)


def _on_corridors(
    rays: NDArray[np.floating], xy: NDArray[np.float64], height: float, corridors: list[Corridor]
) -> NDArray[np.bool_]:
    """(H, W) bool: whether unit rays (H, W, 3) meet the floor, `height` meters below the eye, in a corridor."""
    down = rays[..., 2] < -1e-3
    distance = height / np.where(down, -rays[..., 2], 1.0)
    offset = rays[..., :2] * distance[..., None]
    found = np.zeros(down.shape, bool)
    for corridor in corridors:
        cells = corridor.cells() - xy
        forward = offset_ahead(corridor.heading, 1.0)
        right = np.array([forward[1], -forward[0]])
        along, across = offset @ forward, offset @ right
        reach = cells @ forward
        found |= (along >= reach.min()) & (along <= reach.max()) & (np.abs(across) <= (cells @ right).max())
    return np.asarray(found & down, bool)
