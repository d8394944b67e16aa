"""Read a corridor from a view of the floor: a perspective view that looks down, or a panorama."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.directions import Sphere
from nvsim.graph.types import Evidence
from nvsim.mapping.corridor import DEPTH, NEAR, WIDTH, Corridor, HeightAt, SupportAt
from nvsim.mapping.views.floor_pixels import Eye, FloorPixels, size_of


@lru_cache(maxsize=64)
def _pixels(eye: Eye, corridor: Corridor, floor_at: HeightAt) -> FloorPixels:
    return FloorPixels.of(eye, corridor.ground(floor_at))


@dataclass(frozen=True, eq=False)
class FloorView:
    """A rendered view of the floor. Images are float32 and valid where `seen` is true.

    submap     index of the submap whose model was rendered
    camera     the camera or panorama
    alpha      (H, W) accumulated alpha
    normal_z   (H, W) world z of the normals of the Gaussians
    seen       (H, W) bool, the rendered pixels
    depth      (H, W) depth of the Gaussians times alpha, meters along the optical axis, or along the ray for a
               panorama; None if no depth was rendered
    network_z  (H, W) world z of the unit normals that a network predicts; None if no network was used
    """

    submap: int
    camera: Eye
    alpha: NDArray[np.float32]
    normal_z: NDArray[np.float32]
    seen: NDArray[np.bool_]
    depth: NDArray[np.float32] | None = None
    network_z: NDArray[np.float32] | None = None

    def shows_corridor(self, corridor: Corridor, floor_at: HeightAt) -> bool:
        """Whether all pixels that `corridor` is read from were rendered."""
        return _pixels(self.camera, corridor, floor_at).are_marked(self.seen)


def pixels_read(camera: Eye, corridors: Sequence[Corridor], floor_at: HeightAt) -> NDArray[np.bool_]:
    """Return (H, W) bool: the pixels of a view from which `measure` reads `corridors`."""
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
    """Return the evidence that `view` shows on the floor cells of `corridor`, without a decision. Cells in `free`
    (rows, cells) count as free floor because of other evidence than the view.

    The upward component is that of the composite image. The part of a ray that passes every Gaussian, 1 - alpha, meets
    the floor of the background. The normal of that floor points up and is added to the normals of the Gaussians. The
    upward component is therefore not independent of alpha. The normals of a network are independent, because the
    network only sees the rendered image.

    The depth is that of the composite as well: this part of the ray ends at the floor, where a floor-aware model has no
    Gaussians to end it.
    """
    ground, pixels = corridor.ground(floor_at), _pixels(view.camera, corridor, floor_at)

    def read(values: NDArray[np.float64], floor: float) -> NDArray[np.float64]:
        return values if free is None else np.where(free, floor, values)

    # Outside the view, cells count as blocked: alpha is 1, without normal and depth.
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
