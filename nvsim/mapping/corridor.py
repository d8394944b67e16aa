"""Corridors on the floor and how they are read out of views that look down on it.

A corridor is measured wider than any robot that may be asked about, in cells of equal ground area, so that the same
evidence answers for another robot. Directions: number k is `lattice_offset` + 45 k degrees, 0 is +y, right is positive.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.graph.types import Evidence
from nvsim.mapping.config import WIDEST, MappingConfig
from nvsim.mapping.floor_pixels import FloorPixels
from nvsim.mapping.view_source import Ensemble, ViewSource

HeightAt = Callable[[NDArray[np.floating]], NDArray[np.floating]]
"""The floor's height (...) at world points (..., 3), whose z is the height of a camera or of a floor near which it is
looked for, or at places (..., 2) of a building of one storey."""
SupportAt = Callable[[NDArray[np.floating]], NDArray[np.bool_]]
"""Whether the floor at such points is known, (...)."""

DIRECTIONS = 8
NEAR, DEPTH, WIDTH = 0.05, 0.1, WIDEST  # metres: start of the first row, depth of a row, measured width
CELLS = 18  # across the width: 0.05 m each
_PITCH = -np.pi / 4
# 5 degrees behind straight down and above the horizon, so that a corridor between two directions fits either view.
_FOV = np.radians(100.0)
# Half of the measured width: the largest radius that can be asked about later.
_BEYOND = WIDTH / 2
_LEVEL = 0.3  # metres: a corridor whose floor differs by more from where it begins may lead to another storey


def headings(config: MappingConfig) -> NDArray[np.float64]:
    """(8,) radians."""
    return np.radians(config.lattice_offset + 45.0 * np.arange(DIRECTIONS))


def ahead(heading: float, distance: float) -> NDArray[np.float64]:
    """(2,) world x, y offset."""
    return distance * np.array([np.sin(heading), np.cos(heading)])


def camera_towards(position: NDArray[np.floating], heading: float, config: MappingConfig) -> Camera:
    """A view from a little behind straight down to a little above the horizon: it holds every cell of a corridor within
    22.5 degrees of `heading`."""
    x, y, z = (float(v) for v in position)
    return _camera((x, y, z), float(heading), config.view_size)


@lru_cache(maxsize=16)
def _camera(place: tuple[float, float, float], heading: float, size: int) -> Camera:
    return Camera(Intrinsics.from_fov(size, size, _FOV), look(np.array(place), heading, _PITCH))


@dataclass(frozen=True)
class Corridor:
    """start and target (x, y) metres, world. eye: world z of the camera over the start, which says on which storey it
    begins; None where there is one."""

    start: tuple[float, float]
    target: tuple[float, float]
    eye: float | None = None

    @property
    def length(self) -> float:
        return float(np.hypot(self.target[0] - self.start[0], self.target[1] - self.start[1]))

    @property
    def heading(self) -> float:
        """Radians in [0, 2 pi)."""
        return float(np.arctan2(self.target[0] - self.start[0], self.target[1] - self.start[1]) % (2 * np.pi))

    @property
    def rows(self) -> int:
        return max(1, int(np.ceil((self.length + _BEYOND - NEAR) / DEPTH - 1e-9)))

    def cells(self) -> NDArray[np.float64]:
        """(rows, CELLS, 2) world x, y of the cell centres, rows from near to far, cells from left to right."""
        along = NEAR + (np.arange(self.rows) + 0.5) * DEPTH
        across = ((np.arange(CELLS) + 0.5) / CELLS - 0.5) * WIDTH
        forward = ahead(self.heading, 1.0)
        right = np.array([forward[1], -forward[0]])
        return np.array(self.start) + along[:, None, None] * forward + across[None, :, None] * right

    def ground(self, floor_at: HeightAt) -> NDArray[np.float64]:
        """(rows, CELLS, 3) the cell centres on the floor, not to be changed. Of storeys over one another it is the
        floor that leads on from the start: on a slope it is followed row by row."""
        return _ground(self, floor_at)

    def _ground(self, floor_at: HeightAt) -> NDArray[np.float64]:
        ground = np.empty((self.rows, CELLS, 3))
        ground[..., :2] = self.cells()
        if self.eye is None:
            ground[..., 2] = floor_at(ground[..., :2])
            return ground
        level = ground[..., 2] = _level(self.start, self.eye, floor_at)
        found = np.asarray(floor_at(ground), np.float64)
        if np.abs(found - level).max() > _LEVEL:
            for row in ground:
                row[:, 2] = level
                row[:, 2] = floor_at(row)
                level = float(np.median(row[:, 2]))
            return ground
        ground[..., 2] = found
        return ground

    def end(self, floor_at: HeightAt) -> float:
        """World z of the floor at the target, as `ground` follows it."""
        row = round((self.length - NEAR) / DEPTH - 0.5)
        return float(np.median(self.ground(floor_at)[min(max(row, 0), self.rows - 1), :, 2]))


@lru_cache(maxsize=16)
def _level(start: tuple[float, float], eye: float, floor_at: HeightAt) -> float:
    return float(floor_at(np.array([*start, eye])))


# The corridors of one viewpoint are asked about several times: what to render, what was seen, where each ends.
@lru_cache(maxsize=128)
def _ground(corridor: Corridor, floor_at: HeightAt) -> NDArray[np.float64]:
    found = corridor._ground(floor_at)
    found.setflags(write=False)
    return found


@lru_cache(maxsize=64)
def _pixels(camera: Camera, corridor: Corridor, floor_at: HeightAt) -> FloorPixels:
    return FloorPixels.of(camera, corridor.ground(floor_at))


@dataclass(frozen=True, eq=False)
class FloorView:
    """A view of the floor: alpha (H, W), normal_z (H, W), the world z of the Gaussians' normals, and where depth was
    rendered depth (H, W), that of the Gaussians times alpha, metres along the optical axis; all float32 and right where
    `seen` (H, W) is true."""

    submap: int
    camera: Camera
    alpha: NDArray[np.float32]
    normal_z: NDArray[np.float32]
    seen: NDArray[np.bool_]
    depth: NDArray[np.float32] | None = None

    def shows(self, corridor: Corridor, floor_at: HeightAt) -> bool:
        """Whether every pixel that `corridor` is read from was rendered."""
        return bool(self.seen.reshape(-1)[_pixels(self.camera, corridor, floor_at).read].all())


def look_down(
    source: ViewSource,
    position: NDArray[np.floating],
    wanted: Mapping[int, Sequence[Corridor]],
    floor_at: HeightAt,
    config: MappingConfig,
    submap: int | None = None,
) -> dict[int, FloorView]:
    """Renders a view for each lattice direction in `wanted`, of the pixels that its corridors are read from; with
    `submap` from the model of that one, for which `source` must be an Ensemble."""
    towards = headings(config)
    cameras = [camera_towards(position, towards[k], config) for k in wanted]
    masks = [pixels_read(c, corridors, floor_at) for c, corridors in zip(cameras, wanted.values(), strict=True)]
    if submap is None:
        submap, outputs = source.views(np.asarray(position, np.float64), cameras, masks)
    else:
        assert isinstance(source, Ensemble)
        outputs = source.views_of(submap, cameras, masks)
    views = {}
    for k, camera, output, mask in zip(wanted, cameras, outputs, masks, strict=True):
        if output.alpha is None or output.normal is None:
            raise ValueError("the source rendered no alpha or no normal")
        normal_z = np.ascontiguousarray(output.normal[..., 2])
        depth = None if output.depth is None else output.alpha * output.depth
        views[k] = FloorView(submap, camera, output.alpha, normal_z, mask, depth)
    return views


def pixels_read(camera: Camera, corridors: Sequence[Corridor], floor_at: HeightAt) -> NDArray[np.bool_]:
    """(H, W) the pixels of a view that `measure` reads `corridors` from."""
    mask = np.zeros((camera.intrinsics.height, camera.intrinsics.width), bool)
    for corridor in corridors:
        mask.reshape(-1)[_pixels(camera, corridor, floor_at).read] = True
    return mask


def view_of(corridor: Corridor, config: MappingConfig) -> int:
    """The lattice direction whose view shows `corridor`: the nearest. One rule for all corridors, so that evidence is
    the same whether a whole turn was rendered or one view alone."""
    off = np.abs((corridor.heading - headings(config) + np.pi) % (2 * np.pi) - np.pi)
    return int(np.argmin(np.round(off, 6)))


def measure(
    view: FloorView,
    viewpoint: str,
    direction: int,
    corridor: Corridor,
    floor_at: HeightAt,
    support: SupportAt,
    joins: str = "",
) -> Evidence:
    """What `view` shows on the floor cells of `corridor`; the decision is left empty.

    The upward component is that of the composite: what of the ray passes every Gaussian, 1 - alpha, meets the
    background's floor, whose normal points up, and adds to the z of the Gaussians' normals. The depth is the
    composite's too: that share of the ray ends at the floor, where a floor-aware model has no Gaussians to end it.
    """
    ground, pixels = corridor.ground(floor_at), _pixels(view.camera, corridor, floor_at)
    alpha = np.where(pixels.inside, pixels.values(view.alpha), 1.0)
    normal_z = np.where(pixels.inside, pixels.values(view.normal_z), 0.0)
    reach = None
    if view.depth is not None:
        share = pixels.values(view.depth) / np.maximum(pixels.depth, 1e-6) + (1.0 - alpha)
        reach = _bytes(np.where(pixels.inside, share, 0.0))
    return Evidence(
        viewpoint,
        direction,
        corridor.heading,
        corridor.length,
        _bytes(alpha),
        _bytes((1.0 - alpha) + normal_z),
        np.asarray(support(ground), bool),
        NEAR,
        DEPTH,
        WIDTH,
        view.submap,
        corridor.target,
        joins,
        reach=reach,
    )


def nothing_stands(corridor: Corridor, viewpoint: str, floor_at: HeightAt, support: SupportAt) -> Evidence:
    """The evidence of `corridor` on floor that is level and empty, as far as it is known."""
    known = np.asarray(support(corridor.ground(floor_at)), bool)
    empty, full = np.zeros(known.shape, np.uint8), np.full(known.shape, 255, np.uint8)
    place = viewpoint, -1, corridor.heading, corridor.length
    return Evidence(*place, empty, full, known, NEAR, DEPTH, WIDTH, -1, corridor.target, reach=full, mass=empty)


def _bytes(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.round(np.clip(values, 0.0, 1.0) * 255).astype(np.uint8)
