"""Snaps network normals to the main directions of a building: up, down, and four horizontal directions at right angles.

Most surfaces of a building face one of these directions. A network errs most in the heading of walls, by a different
amount in every image. Therefore the headings of a capture are estimated from many images together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.capture.types import Frame
from nvsim.geometry.camera import Camera
from nvsim.geometry.sampling import evenly_spaced
from nvsim.perception.roles import Float32, Image, SurfaceNormals

_UPRIGHT = 0.5
"""Greatest absolute upward component of a wall's normal."""
_WALL, _LEVEL = np.cos(np.radians(35.0)), np.cos(np.radians(10.0))
"""Cosines of the greatest angles by which a normal is turned: to a heading (35 degrees), and to up or down (10
degrees). With more than 10 degrees a prompted region would cross the edges of low objects. Ramps are less steep than
that."""
_NEAR, _OWN, _APART = np.radians(10.0), 0.7, np.radians(15.0)
_LEAST = 0.3
"""A capture has a heading if at least this share of its walls is within `_NEAR` of it (0.22 for round walls). An image
stays unchanged if a share of `_OWN` of its walls has another heading, at least `_APART` from all headings of the
capture: it shows a part of the building at another angle."""
_FRAMES, _SIDE = 24, 320
"""Number of frames from which the headings of a capture are estimated, and their longer side, pixels."""
_BINS = 90
_QUARTER = np.pi / 2


def main_headings(images: Iterable[Float32]) -> tuple[float, ...]:
    """The headings of most walls, radians from 0 to pi / 2 (a heading includes its right angles), the most frequent
    first. `images` are unit normals (..., 3) float32, world, of each image; all images have equal weight. Empty if the
    walls have no dominant heading."""
    walls = [found for found in map(_wall_headings, images) if len(found) >= _BINS]
    if not walls:
        return ()
    headings = np.concatenate(walls)
    weights = np.concatenate([np.full(len(found), 1 / len(found) / len(walls)) for found in walls])
    left, found = np.ones(len(headings), bool), list[float]()
    while True:
        heading = _peak(headings[left], weights[left])
        near = np.abs(_quarter_turn_difference(headings, heading)) < _NEAR
        if weights[near & left].sum() < _LEAST:
            return tuple(found)
        found.append(heading)
        left &= np.abs(_quarter_turn_difference(headings, heading)) > _APART
        if not left.any():
            return tuple(found)


def straighten_normals(normals: Float32, headings: tuple[float, ...]) -> Float32:
    """(H, W, 3) float32: the unit normals (H, W, 3) of an image, world, with those near a main direction snapped to it.
    Directions are the vertical and the four ways of the heading that fits the image best. Zeros stay zero."""
    heading = _of_image(normals, headings)
    ways = [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]
    least = [_LEVEL, _LEVEL]
    if heading is not None:
        angles = heading + _QUARTER * np.arange(4)
        ways += [(float(np.cos(a)), float(np.sin(a)), 0.0) for a in angles]
        least += [_WALL] * 4
    turned = np.array(normals, np.float32)
    for way, cosine in zip(np.array(ways, np.float32), least):
        turned[normals @ way > cosine] = way
    return turned


def _of_image(normals: Float32, headings: tuple[float, ...]) -> float | None:
    """The heading of an image in radians; None if it matches none of `headings`."""
    if not headings:
        return None
    walls = _wall_headings(normals)
    if len(walls) < _BINS:
        return headings[0]
    own = _peak(walls, np.ones(len(walls)))
    if _share(walls, own) > _OWN and min(abs(float(_quarter_turn_difference(own, h))) for h in headings) > _APART:
        return None
    return max(headings, key=lambda heading: _share(walls, heading))


def _wall_headings(normals: Float32) -> NDArray[np.float32]:
    """(N,) wall headings from 0 to pi / 2, from every fourth row and column."""
    some = normals[::4, ::4] if normals.ndim == 3 else normals
    walls = some[(np.abs(some[..., 2]) < _UPRIGHT) & some.any(axis=-1)]
    return np.asarray(np.arctan2(walls[:, 1], walls[:, 0]) % _QUARTER, np.float32)


def _peak(headings: NDArray[np.float32], weights: NDArray[np.float64]) -> float:
    """The middle of the 7 degrees with the most weight."""
    counts, _ = np.histogram(headings, _BINS, (0.0, _QUARTER), weights=weights)
    smooth = sum(np.roll(counts, k) for k in range(-3, 4))
    middle = (float(np.argmax(smooth)) + 0.5) * _QUARTER / _BINS
    off = _quarter_turn_difference(headings, middle)
    near = np.abs(off) < np.radians(6)
    return float((middle + np.median(off[near])) % _QUARTER) if near.any() else middle


def _quarter_turn_difference(a: NDArray[np.float32] | float, b: float) -> NDArray[np.float32]:
    """The angle from `b` to `a`, from -pi / 4 to pi / 4."""
    return np.asarray((a - b + _QUARTER / 2) % _QUARTER - _QUARTER / 2)


def _share(headings: NDArray[np.float32], heading: float) -> float:
    return float((np.abs(_quarter_turn_difference(headings, heading)) < _NEAR).mean())


@dataclass(frozen=True)
class StraightNormals:
    """A SurfaceNormals that applies `straighten_normals` to the normals of another one, with the capture's headings."""

    seen: SurfaceNormals
    headings: tuple[float, ...]

    @classmethod
    def of_capture(cls, seen: SurfaceNormals, frames: Sequence[Frame]) -> StraightNormals:
        """Estimates the headings with `seen` on some frames spread over the trajectory. Raises InputError for an image
        that cannot be read."""

        def normals_of_frames() -> Iterator[Float32]:
            for frame in (frames[i] for i in evenly_spaced(len(frames), _FRAMES)):
                small = frame.intrinsics.limited_to(_SIDE)
                yield seen.normals(read_image(frame, small), Camera(small, frame.camera.camera_to_world))

        return cls(seen, main_headings(normals_of_frames()))

    def normals(self, image: Image, camera: Camera) -> Float32:
        """(H, W, 3) float32, unit length, world frame, for an image (H, W, 3); zero if unknown."""
        return straighten_normals(self.seen.normals(image, camera), self.headings)
