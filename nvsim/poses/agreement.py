"""How well camera poses agree with matches between images that were found without the poses.

For a pair of images, the relative pose limits where a match can be. It is on an arc. One end is
the direction of the ray itself (a point at infinity), the other end is the direction of the other camera (a point at
distance zero). The angle between a match and this arc, in pixels, separates wrong poses from correct ones. It works at
any scale, also without parallax.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Frame
from nvsim.geometry.lens import Lens
from nvsim.poses.overlap import SIDE, Overlap

Float = NDArray[np.float64]
AGREES = 4.0  # pixels of an image of SIDE: poses agree with a pair if its median miss is smaller
_MOVES = 12.0  # pixels by which the matches of a pair must move; pairs that move less agree with any poses
_ITERATIONS = 20


@dataclass(frozen=True, eq=False)
class Evidence:
    """The informative image pairs of a capture, each with M matches (repeated to fill up).

    frames   (P, 2) int64, indices of the two frames
    lenses   (P, 2) int64, indices into `kinds`
    kinds    the different lenses
    places   (P, 2, M, 2) float64, pixels of the stored images
    factors  (P,) float64, pixels of an image of SIDE per pixel of the stored image
    """

    frames: NDArray[np.int64]
    lenses: NDArray[np.int64]
    kinds: tuple[Lens, ...]
    places: Float
    factors: Float

    def __len__(self) -> int:
        return len(self.frames)

    def select_pairs(self, rows: NDArray[np.bool_]) -> Evidence:
        """The pairs selected by the mask `rows` (P,)."""
        return Evidence(self.frames[rows], self.lenses[rows], self.kinds, self.places[rows], self.factors[rows])

    def rays(self, kinds: Sequence[Lens] | None = None) -> Float:
        """(P, 2, M, 3) unit directions in the camera frames. `kinds` are lenses to use instead of the stored ones."""
        rays = np.empty((*self.places.shape[:3], 3))
        for number, lens in enumerate(kinds or self.kinds):
            rows = self.lenses == number
            rays[rows] = directions(lens, self.places[rows])
        return rays

    def focal(self, kinds: Sequence[Lens] | None = None) -> Float:
        """(P,) focal lengths near the image center: pixels of an image of SIDE per radian."""
        focal = np.array([np.mean(lens.focal) for lens in kinds or self.kinds])
        return np.asarray(focal[self.lenses].mean(axis=1) * self.factors)


def evidence_of(frames: Sequence[Frame], pairs: Sequence[Overlap]) -> Evidence:
    """Selects the pairs whose matches move far enough to distinguish correct poses from wrong ones."""
    kinds = tuple(dict.fromkeys(f.lens for f in frames))
    number = {lens: i for i, lens in enumerate(kinds)}
    most = max((len(p.places) for p in pairs), default=1)
    indices, lenses, places, factors = [], [], [], []
    for pair in pairs:
        one, other = frames[pair.first].lens, frames[pair.second].lens
        factor = min(1.0, SIDE / max(one.width, one.height))
        size = np.array([[one.width, one.height], [other.width, other.height]])
        moved = pair.places - size / 2
        if np.median(np.linalg.norm(moved[:, 0] - moved[:, 1], axis=1)) * factor < _MOVES:
            continue
        indices.append((pair.first, pair.second))
        lenses.append((number[one], number[other]))
        places.append(pair.places[np.arange(most) % len(pair.places)].transpose(1, 0, 2))
        factors.append(factor)
    return Evidence(
        np.array(indices, np.int64).reshape(-1, 2),
        np.array(lenses, np.int64).reshape(-1, 2),
        kinds,
        np.array(places, np.float64).reshape(-1, 2, most, 2),
        np.array(factors, np.float64),
    )


def match_errors(poses: Float, evidence: Evidence, rays: Float, focal: Float) -> Float:
    """(P,) median distance of the matches of each pair from the positions that the poses allow, pixels of an image of
    SIDE. `poses` (N, 4, 4) are camera to world and may be mirrored. `rays` (P, 2, M, 3) and `focal` (P,) come from
    `Evidence`."""
    first, second = poses[evidence.frames[:, 0]], poses[evidence.frames[:, 1]]
    back = np.swapaxes(second[:, :3, :3], 1, 2)
    turn = back @ first[:, :3, :3]
    far = np.einsum("pij,pmj->pmi", turn, rays[:, 0])
    shift = np.einsum("pij,pj->pi", back, first[:, :3, 3] - second[:, :3, 3])
    length = np.linalg.norm(shift, axis=1, keepdims=True)
    near = shift / np.maximum(length, 1e-12)
    near = np.where((length > 1e-9)[:, None], near[:, None], far)
    return np.asarray(np.median(angles_to_arcs(rays[:, 1], far, near), axis=1) * focal)


def angles_to_arcs(directions: Float, begin: Float, end: Float) -> Float:
    """(...) radians between unit `directions` (..., 3) and the shorter great-circle arcs from `begin` to `end`."""
    normal = np.cross(begin, end)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.maximum(size, 1e-12)
    beside = (directions * normal).sum(axis=-1)
    foot = directions - beside[..., None] * normal
    within = (np.cross(begin, foot) * normal).sum(axis=-1) >= 0
    within &= (np.cross(foot, end) * normal).sum(axis=-1) >= 0
    within &= size[..., 0] > 1e-9
    ends = np.minimum(_angles(directions, begin), _angles(directions, end))
    return np.where(within, np.arcsin(np.clip(np.abs(beside), 0, 1)), ends)


def _angles(a: Float, b: Float) -> Float:
    return np.asarray(2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=-1) / 2, 0, 1)))


def directions(lens: Lens, pixels: Float) -> Float:
    """(..., 3) unit directions, OpenCV axes, of pixels (..., 2) of the stored image."""
    focal, middle = np.array(lens.focal), np.array(lens.principal_point)
    plane = (pixels - middle) / focal
    if lens.is_distorted:
        target, limit = pixels, 3.0
        for _ in range(_ITERATIONS):
            plane = np.clip(plane + (target - lens.distort(plane)) / focal, -limit, limit)
    rays = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
