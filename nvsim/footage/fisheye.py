"""Recognize the images of a fisheye lens, and turn them into images of a pinhole camera.

Action cameras have lenses of 100 to 180 degrees whose images keep angles: the distance of a point from the center of
the image is proportional to the angle of its ray (equidistant projection). A perspective camera with radial distortion
cannot describe such a lens. Epipolar geometry tells both apart: matched points of two images of a rigid scene fit an
epipolar geometry only if their rays are right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Intrinsics
from nvsim.geometry.lens import Lens

Matched = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Matched pixels (M, 2) of two images."""

_ANGLES = np.radians(np.arange(80.0, 191.0, 10.0))  # angles of view along the longer side that are tested
_FOCALS = np.geomspace(0.38, 1.8, 9)  # focal lengths of pinhole cameras over the longer side that are tested
_FINER = np.radians(np.arange(-6.0, 7.0, 2.0))  # around the best angle
_WIDEST = 100.0  # degrees along the longer side of the pinhole images; outside, pixels are stretched more than twice
_STEEPEST = 0.3  # cosine of the angle from the axis, at least, of rays from which the relative pose is computed
_SAMPLED, _WITHIN = 1.5, 3.0  # distance from the epipolar line of a match that fits, in pixels of an image of 1,000
_SAMPLES = 200  # relative poses that are tested for a pair
_FEWEST, _MOST = 60, 250  # matches of a pair
PAIRS = 16
"""Pairs of images from which a lens is found, at most."""
_BETTER = 1.05  # how well matches fit a fisheye lens over how well they fit a pinhole camera, at least


@dataclass(frozen=True)
class Fisheye:
    """An equidistant lens with its center in the middle of the image, and the pinhole images made from it.

    width, height  pixels of the images, before and after
    focal          pixels per radian
    """

    width: int
    height: int
    focal: float

    @property
    def degrees(self) -> float:
        """Angle of view along the longer side."""
        return float(np.degrees(max(self.width, self.height) / self.focal))

    @cached_property
    def pinhole(self) -> Intrinsics:
        """The camera of the pinhole images. They have the size of the fisheye images and at most 100 degrees."""
        angle = np.radians(min(self.degrees, _WIDEST))
        focal = max(self.width, self.height) / 2 / np.tan(angle / 2)
        return Intrinsics(self.width, self.height, focal, focal, self.width / 2, self.height / 2)

    @cached_property
    def _map(self) -> NDArray[np.float32]:
        center = self.width / 2, self.height / 2
        lens = Lens("SIMPLE_RADIAL_FISHEYE", self.width, self.height, (self.focal, *center, 0.0))
        return lens.undistort_map(self.pinhole)

    def rectified(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The pinhole image (H, W, 3) of a fisheye image (H, W, 3), uint8."""
        return np.asarray(cv2.remap(image, self._map[..., 0], self._map[..., 1], cv2.INTER_CUBIC), np.uint8)

    def places(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 2) pixels of the pinhole image, of fisheye pixels (N, 2). NaN outside the pinhole image."""
        rays = rays_of(pixels, self.width, self.height, self.focal)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = rays[:, :2] / rays[:, 2:] * self.pinhole.fx + (self.width / 2, self.height / 2)
        outside = (rays[:, 2] <= 1e-6) | (found < 0).any(axis=1) | (found > (self.width, self.height)).any(axis=1)
        found[outside] = np.nan
        return found


def rays_of(pixels: NDArray[np.float64], width: int, height: int, focal: float) -> NDArray[np.float64]:
    """(N, 3) unit directions of pixels (N, 2) of an equidistant lens with `focal` pixels per radian."""
    offset = (pixels - (width / 2, height / 2)) / focal
    angle = np.linalg.norm(offset, axis=1)
    return np.column_stack([offset * np.sinc(angle / np.pi)[:, None], np.cos(angle)])


def find_fisheye(pairs: Sequence[Matched], width: int, height: int) -> Fisheye | None:
    """The fisheye lens of images of `width` x `height` pixels with matched points. None for a lens that a pinhole
    camera describes, and if too few points are matched."""
    usable = [pair for pair in pairs if len(pair[0]) >= _FEWEST]
    usable = usable[:: max(1, -(-len(usable) // PAIRS))]
    if len(usable) < PAIRS // 4:
        return None
    longer, rng = max(width, height), np.random.default_rng(0)
    rows = [rng.permutation(len(one))[:_MOST] for one, _ in usable]
    sampled = [(one[k], other[k]) for (one, other), k in zip(usable, rows, strict=True)]

    def pinhole_fit(focal: float) -> float:
        rays = [tuple(_pinhole_rays(places, width, height, focal) for places in pair) for pair in sampled]
        return sum(_fit(a, b, focal / longer, a[:, 2] ** 2, b[:, 2] ** 2) for a, b in rays)

    def fisheye_fit(angle: float) -> float:
        rays = [tuple(rays_of(places, width, height, longer / angle) for places in pair) for pair in sampled]
        return sum(_fit(a, b, 1 / angle, np.ones(len(a)), np.ones(len(b))) for a, b in rays)

    fits = [fisheye_fit(angle) for angle in _ANGLES]
    if max(fits) < _BETTER * max(pinhole_fit(longer * focal) for focal in _FOCALS):
        return None
    angles = _ANGLES[int(np.argmax(fits))] + _FINER
    best = float(angles[int(np.argmax([fisheye_fit(angle) for angle in angles]))])
    return Fisheye(width, height, longer / best)


def _pinhole_rays(pixels: NDArray[np.float64], width: int, height: int, focal: float) -> NDArray[np.float64]:
    rays = np.column_stack([(pixels - (width / 2, height / 2)) / focal, np.ones(len(pixels))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _fit(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    focal: float,
    scale_a: NDArray[np.float64],
    scale_b: NDArray[np.float64],
) -> float:
    """How many matched rays (N, 3) agree with one relative pose; a ray counts the less, the larger its distance.
    `focal` is in units of the longer side; `scale_a` and `scale_b` (N,) are the radians that a pixel at the ray covers,
    over those at the center."""
    ahead = (a[:, 2] > _STEEPEST) & (b[:, 2] > _STEEPEST)
    one, other = (np.ascontiguousarray(rays[ahead, :2] / rays[ahead, 2:]) for rays in (a, b))
    try:
        within = _SAMPLED / 1000 / focal
        found, _ = cv2.findEssentialMat(one, other, np.eye(3), cv2.USAC_MAGSAC, 0.999, within, _SAMPLES)
    except cv2.error:  # some degenerate sets of matches fail in an assertion
        return 0.0
    if found is None or found.shape[0] < 3:
        return 0.0
    there, back = a @ found[:3].T, b @ found[:3]
    error = np.abs(np.einsum("ni,ni->n", there, b))
    distance = np.maximum(
        error / np.maximum(np.linalg.norm(there, axis=1), 1e-12) / scale_b,
        error / np.maximum(np.linalg.norm(back, axis=1), 1e-12) / scale_a,
    )
    return float(np.sum(1 - np.minimum((distance * focal * 1000 / _WITHIN) ** 2, 1)))
