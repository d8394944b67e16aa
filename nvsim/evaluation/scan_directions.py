"""Check that the faces of a skybox point in the right directions. A model whose color encodes the direction is exported
in the normal way. The directions decoded from the encoded strip are compared with the true ones."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.scan_sampler import sample_strip
from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.skybox_faces import NAMES
from nvsim.r2r.observations.layout import jpeg
from nvsim.r2r.observations.skybox import focal_of, skybox_of
from nvsim.r2r.observations.surround import draw_surround
from nvsim.splats import harmonics
from nvsim.splats.types import Background, Gaussians, SubmapModel

_HERE = np.array([1.0, -2.0, 1.5])
_SIDE = 160  # pixels of the compared views, which are 80 degrees wide
# Headings and elevations in degrees of the centers of the faces, in order. The pose has heading 0, which is +y.
_MIDDLES = {"up": (0, 90), "back": (180, 0), "left": (270, 0), "front": (0, 0), "right": (90, 0), "down": (0, -90)}


def compass() -> SubmapModel:
    """A model without Gaussians whose background color along a direction (x, y, z) is half the direction plus 0.5."""
    first = harmonics.basis(np.eye(3), 1)[:, 1:]  # (3, 3) the functions of degree 1 along x, y and z
    rest = np.zeros((24, 3), np.float32)
    rest[:3] = 0.5 * np.linalg.inv(first)
    f = np.float32
    weights = {
        "embed.0.weight": np.zeros((1, 27), f),
        "embed.0.bias": np.zeros(1, f),
        "trunk.0.weight": np.zeros((1, 1), f),
        "trunk.0.bias": np.zeros(1, f),
        "base.weight": np.zeros((3, 1), f),
        "base.bias": np.full(3, 0.5 / harmonics.DC, f),
        "rest.weight": np.zeros((72, 1), f),
        "rest.bias": rest.reshape(-1),
    }
    return SubmapModel(Gaussians.empty(), Background(weights), None, FloorSurface.flat(0))


def direction_errors(side: int, quality: int) -> dict[str, dict[str, float]]:
    """Face -> degrees. `turned` is the rotation of the whole face (best fit). `mean` is the mean error of its pixels,
    of which 8 bits and JPEG alone cause 0.1 to 0.2."""
    model = compass()
    skybox = skybox_of(draw_surround(model, _HERE, focal_of(side)), model.floor, side)
    data = np.frombuffer(jpeg(skybox.colour, quality, whole_chroma=True), np.uint8)
    strip = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1]
    found = {}
    for name in NAMES:
        heading, elevation = map(math.radians, _MIDDLES[name])
        camera = Camera(Intrinsics.from_fov(_SIDE, _SIDE, math.radians(80)), look(_HERE, heading, elevation))
        rays = camera.rays().astype(np.float64).reshape(-1, 3)
        seen = 2 * (sample_strip(strip, rays).astype(np.float64) / 255) - 1
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        found[name] = {"turned": _turn(rays, seen), "mean": float(np.degrees(_angles(rays, seen)).mean())}
    return found


def _turn(rays: NDArray[np.float64], seen: NDArray[np.float64]) -> float:
    """Degrees of the rotation that best maps `rays` (N, 3) to `seen` (N, 3) (Kabsch 1976)."""
    u, _, v = np.linalg.svd(rays.T @ seen)
    u[:, -1] *= np.sign(np.linalg.det(u @ v))
    return math.degrees(math.acos(min(1.0, (np.trace(u @ v) - 1) / 2)))


def _angles(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)), np.float64)
