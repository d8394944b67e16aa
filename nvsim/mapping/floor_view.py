"""How a corridor is read out of a view of the floor: a perspective view that looks down, or a panorama."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.sphere import Sphere
from nvsim.graph.types import Evidence
from nvsim.mapping.corridor import DEPTH, NEAR, WIDTH, Corridor, HeightAt, SupportAt

Eye = Camera | Sphere
"""What places of the world are looked up with: both project points to pixels, and say how far those are."""


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
        rows, columns = _read(self.camera, corridor, floor_at)
        return bool(self.seen[rows, columns].all())


def pixels_read(camera: Eye, corridors: Sequence[Corridor], floor_at: HeightAt) -> NDArray[np.bool_]:
    """(H, W) the pixels of a view that `measure` reads `corridors` from."""
    mask = np.zeros(_size(camera), bool)
    for corridor in corridors:
        mask[_read(camera, corridor, floor_at)] = True
    return mask


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
    background's floor, whose normal points up, and adds to the z of the Gaussians' normals. So it is no second opinion
    on alpha; that of a network, which sees the rendered image alone, is. The depth is the composite's too: that share
    of the ray ends at the floor, where a floor-aware model has no Gaussians to end it.
    """
    ground = corridor.ground(floor_at)
    pixels, inside, to_floor = _pixels_of(view.camera, ground)
    wraps = isinstance(view.camera, Sphere)
    alpha = np.where(inside, _bilinear(view.alpha, pixels, wraps), 1.0)
    normal_z = np.where(inside, _bilinear(view.normal_z, pixels, wraps), 0.0)
    reach = network_up = None
    if view.depth is not None:
        share = _bilinear(view.depth, pixels, wraps) / np.maximum(to_floor, 1e-6) + (1.0 - alpha)
        reach = _bytes(np.where(inside, share, 0.0))
    if view.network_z is not None:
        network_up = _bytes(np.where(inside, _bilinear(view.network_z, pixels, wraps), 0.0))
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
        views="panorama" if wraps else "pitched",
    )


def _bytes(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.round(np.clip(values, 0.0, 1.0) * 255).astype(np.uint8)


def _size(camera: Eye) -> tuple[int, int]:
    """Height and width, pixels."""
    size = camera if isinstance(camera, Sphere) else camera.intrinsics
    return size.height, size.width


def _pixels_of(
    camera: Eye, ground: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """(rows, CELLS, 2) pixels of points (rows, CELLS, 3), (rows, CELLS) whether they lie in the image, with a pixel's
    grace at its border, and (rows, CELLS) how far they are, metres, measured as the view's depth is."""
    pixels, distance = camera.project(ground)
    if isinstance(camera, Sphere):
        return pixels, np.ones(distance.shape, bool), distance
    (height, width), u, v = _size(camera), pixels[..., 0], pixels[..., 1]
    inside = (distance > 0) & (u > -1) & (v > -1) & (u < width + 1) & (v < height + 1)
    return pixels, np.asarray(inside), np.asarray(distance)


def _read(camera: Eye, corridor: Corridor, floor_at: HeightAt) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns (n,) of all pixels that `_bilinear` reads for the cells of `corridor` inside the image."""
    pixels, inside, _ = _pixels_of(camera, corridor.ground(floor_at))
    around = _neighbours(pixels[inside], _size(camera), isinstance(camera, Sphere))
    u0, u1, v0, v1, *_ = (a.astype(np.int64) for a in around)
    return np.concatenate([v0, v0, v1, v1]), np.concatenate([u0, u1, u0, u1])


def _neighbours(pixels: NDArray[np.float64], shape: tuple[int, ...], wraps: bool) -> tuple[NDArray[Any], ...]:
    """Of pixels (..., 2), whose centres lie at halves: the columns and rows of the four pixels around, border pixels
    for what is outside, u0, u1, v0, v1, and how far between them, fu, fv. Where the image `wraps`, its last column
    lies beside its first."""
    height, width = shape
    v = np.clip(pixels[..., 1] - 0.5, 0, height - 1)
    u = (pixels[..., 0] - 0.5) % width if wraps else np.clip(pixels[..., 0] - 0.5, 0, width - 1)
    u0, v0 = u.astype(np.int64), v.astype(np.int64)
    if wraps:
        u0 %= width  # a rounded remainder may be the width itself
    u1 = (u0 + 1) % width if wraps else np.minimum(u0 + 1, width - 1)
    return u0, u1, v0, np.minimum(v0 + 1, height - 1), u - np.floor(u), v - v0


def _bilinear(picture: NDArray[np.float32], pixels: NDArray[np.float64], wraps: bool) -> NDArray[np.float64]:
    """(...) values at pixels (..., 2)."""
    u0, u1, v0, v1, fu, fv = _neighbours(pixels, picture.shape, wraps)
    top = picture[v0, u0] * (1 - fu) + picture[v0, u1] * fu
    bottom = picture[v1, u0] * (1 - fu) + picture[v1, u1] * fu
    return np.asarray(top * (1 - fv) + bottom * fv, np.float64)
