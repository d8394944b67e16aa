"""How a corridor is read out of a view of the floor: a perspective view that looks down, or a panorama."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.sphere import Sphere
from nvsim.graph.types import Evidence
from nvsim.mapping.corridor import DEPTH, NEAR, WIDTH, Corridor, HeightAt, SupportAt
from nvsim.mapping.floor_pixels import Eye, FloorPixels, size_of


@lru_cache(maxsize=64)
def _pixels(eye: Eye, corridor: Corridor, floor_at: HeightAt) -> FloorPixels:
    return FloorPixels.of(eye, corridor.ground(floor_at))


@dataclass(frozen=True, eq=False)
class FloorView:
    """A view of the floor: alpha (H, W), normal_z (H, W), the world z of the Gaussians' normals, and where depth was
    rendered depth (H, W), that of the Gaussians times alpha, metres along the optical axis, of a panorama along the
    ray; where a network was asked network_z (H, W), the world z of its unit normals. All are float32 and right where
    `seen` (H, W) is true."""

    submap: int
    camera: Eye
    alpha: NDArray[np.float32]
    normal_z: NDArray[np.float32]
    seen: NDArray[np.bool_]
    depth: NDArray[np.float32] | None = None
    network_z: NDArray[np.float32] | None = None

    def shows(self, corridor: Corridor, floor_at: HeightAt) -> bool:
        """Whether every pixel that `corridor` is read from was rendered."""
        return _pixels(self.camera, corridor, floor_at).are_marked(self.seen)


def pixels_read(camera: Eye, corridors: Sequence[Corridor], floor_at: HeightAt) -> NDArray[np.bool_]:
    """(H, W) the pixels of a view that `measure` reads `corridors` from."""
    mask = np.zeros(size_of(camera), bool)
    for corridor in corridors:
        _pixels(camera, corridor, floor_at).mark(mask)
    return mask


def measure(
    view: FloorView,
    viewpoint: str,
    direction: int,
    corridor: Corridor,
    floor_at: HeightAt,
    support: SupportAt,
    joins: str = "",
    free: NDArray[np.bool_] | None = None,
) -> Evidence:
    """What `view` shows on the floor cells of `corridor`; the decision is left empty. Cells in `free` (rows, cells) are
    floor by other evidence than the view.

    The upward component is that of the composite: what of the ray passes every Gaussian, 1 - alpha, meets the
    background's floor, whose normal points up, and adds to the z of the Gaussians' normals. So it is no second opinion
    on alpha; that of a network, which sees the rendered image alone, is. The depth is the composite's too: that share
    of the ray ends at the floor, where a floor-aware model has no Gaussians to end it.
    """
    ground, pixels = corridor.ground(floor_at), _pixels(view.camera, corridor, floor_at)

    def read(values: NDArray[np.float64], floor: float) -> NDArray[np.float64]:
        return values if free is None else np.where(free, floor, values)

    # Outside the view everything stands, without a normal and at no distance.
    alpha = read(pixels.values(view.alpha, 1.0), 0.0)
    normal_z = read(pixels.values(view.normal_z, 0.0), 0.0)
    reach = network_up = None
    if view.depth is not None:
        share = pixels.values(view.depth, 0.0) / np.maximum(pixels.depth, 1e-6) + (1.0 - alpha)
        reach = _bytes(read(np.where(pixels.inside, share, 0.0), 1.0))
    if view.network_z is not None:
        network_up = _bytes(read(pixels.values(view.network_z, 0.0), 1.0))
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
        network_up=network_up,
        views="panorama" if isinstance(view.camera, Sphere) else "pitched",
    )


def _bytes(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.round(np.clip(values, 0.0, 1.0) * 255).astype(np.uint8)
