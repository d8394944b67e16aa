"""The working copy of a frame in the depth stage: its neighbors, the mapping of its pixels to another frame, and its
census transform, which pixels around a pixel are clearly brighter or darker (Zabih and Woodfill, 1994).

The census does not change with exposure. In a uniform region, where only noise differs, it carries no information.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.capture.masks import usable_pixels
from nvsim.capture.types import Frame
from nvsim.geometry.camera import Camera
from nvsim.kernels import njit

_IGNORED = -1e6  # so far below any gray value that interpolation beside it stays negative
NOTHING = np.uint64(0xFFFFFFFFFFFFFFFF)
"""The census of a pixel that is not seen or must not be used. Half of its bits differ from any other census."""
_UP, _LEFT = 3, 4
_AROUND = np.array(
    [(dy, dx) for dy in (-3, -1, 0, 1, 3) for dx in (-4, -2, -1, 0, 1, 2, 4) if dy or abs(dx) in (1, 2)], np.int64
)
"""(32, 2) row and column offsets of the pixels that are compared with the center pixel."""


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_census(
    padded: NDArray[np.float32], threshold: np.float32, offsets: NDArray[np.int64], out: NDArray[np.uint64]
) -> None:
    """Fill `out` (H, W). `padded` has `_UP` more rows and `_LEFT` more columns on every side. The loops run row by row
    with unsigned indices, so that LLVM vectorizes them."""
    for y in range(out.shape[0]):
        middle, to = padded[y + _UP], out[y]
        to[:] = 0
        for i in range(offsets.shape[0]):
            row, shift = padded[y + _UP + offsets[i, 0]], np.uintp(offsets[i, 1] + _LEFT)
            for j in range(out.shape[1]):
                x = np.uintp(j)
                difference = row[x + shift] - middle[x + np.uintp(_LEFT)]
                brighter = np.uint64(1) if difference > threshold else np.uint64(0)
                darker = np.uint64(2) if difference < -threshold else np.uint64(0)
                to[x] = (to[x] << np.uint64(2)) | brighter | darker


def census_of(gray: NDArray[np.float32], threshold: float) -> NDArray[np.uint64]:
    """(H, W) uint64 census of `gray` (H, W) float32.

    It has two bits for each of 32 pixels in a 9 x 7 neighborhood: brighter and darker by more than `threshold` gray
    levels. Border pixels are replicated. A negative gray value marks a pixel that must not be used. If the neighborhood
    of a pixel contains one, its census is `NOTHING`."""
    padded = cv2.copyMakeBorder(gray, _UP, _UP, _LEFT, _LEFT, cv2.BORDER_REPLICATE)
    out = np.empty(gray.shape, np.uint64)
    _fill_census(np.asarray(padded, np.float32), np.float32(threshold), _AROUND, out)
    ignored = (gray < 0).astype(np.uint8)
    if ignored.any():
        out[cv2.dilate(ignored, np.ones((2 * _UP + 1, 2 * _LEFT + 1), np.uint8)) > 0] = NOTHING
    return out


@dataclass(frozen=True, eq=False)
class View:
    """camera  pinhole camera at the working size
    gray    (H, W) float32, gray values, slightly blurred; negative where the frame's mask ignores pixels
    census  (H, W) uint64
    """

    camera: Camera
    gray: NDArray[np.float32]
    census: NDArray[np.uint64]

    @staticmethod
    def read(frame: Frame, longest_side: int, threshold: float) -> View:
        """The view of `frame`, with sides of at most `longest_side` pixels and a census threshold in gray levels.

        Raises InputError if the image cannot be read."""
        intrinsics = frame.intrinsics.limited_to(longest_side)
        image = read_image(frame, intrinsics)
        plain = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
        usable = usable_pixels(frame, intrinsics)
        if usable is None:
            gray = np.asarray(cv2.GaussianBlur(plain, (0, 0), 0.7), np.float32)
        else:  # ignored pixels do not contribute to the blur
            share = cv2.GaussianBlur(usable.astype(np.float32), (0, 0), 0.7)
            blurred = cv2.GaussianBlur(plain * usable, (0, 0), 0.7) / np.maximum(share, 1e-6)
            gray = np.where(usable, blurred, _IGNORED).astype(np.float32)
        return View(Camera(intrinsics, frame.camera_to_world), gray, census_of(gray, threshold))


@dataclass(frozen=True, eq=False)
class Warp:
    """Mapping of pixel indices p of one view to another: p at inverse depth w maps to turned @ p + w * shift. The third
    component is the depth in the other view as a multiple of the depth in the first.

    turned  (3, 3) float64
    shift   (3,) float64
    back    (4,) float64: for a pixel q at depth z in the other view, the depth in the first view is
            z * (back[:3] @ (q, 1)) + back[3]
    """

    turned: NDArray[np.float64]
    shift: NDArray[np.float64]
    back: NDArray[np.float64]

    @staticmethod
    def between(here: Camera, there: Camera) -> Warp:
        relative = there.world_to_camera @ here.camera_to_world
        into, out = matrix_of(there), np.linalg.inv(matrix_of(here))
        turned, shift = into @ relative[:3, :3] @ out, into @ relative[:3, 3]
        backwards = here.world_to_camera @ there.camera_to_world
        back = np.append(backwards[2, :3] @ np.linalg.inv(into), backwards[2, 3])
        return Warp(turned, shift, back)


def matrix_of(camera: Camera) -> NDArray[np.float64]:
    """(3, 3) float64 from camera coordinates to pixel indices; the center of the first pixel is 0."""
    k = camera.intrinsics
    return np.array([[k.fx, 0, k.cx - 0.5], [0, k.fy, k.cy - 0.5], [0, 0, 1]])


class Views:
    """The views of a capture. They are read on demand, and the most recent are cached."""

    def __init__(self, frames: tuple[Frame, ...], longest_side: int, threshold: float, most: int) -> None:
        self.frames = frames
        self._side = longest_side
        self.at = lru_cache(maxsize=most)(lambda i: View.read(frames[i], longest_side, threshold))

    def camera(self, index: int) -> Camera:
        frame = self.frames[index]
        return Camera(frame.intrinsics.limited_to(self._side), frame.camera_to_world)

    def image(self, index: int) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB of a frame. Raises InputError if the image cannot be read."""
        return read_image(self.frames[index], self.camera(index).intrinsics)

    def usable(self, index: int) -> NDArray[np.bool_] | None:
        """(H, W) bool from the mask of a frame, True for pixels to use; None without a mask. Raises InputError if the
        mask cannot be read."""
        return usable_pixels(self.frames[index], self.camera(index).intrinsics)

    @cached_property
    def poses(self) -> NDArray[np.float64]:
        """(N, 4, 4) float64 camera to world."""
        return np.array([f.camera_to_world for f in self.frames])


_DEGREES = 40.0
_WIDE = 60.0  # degrees; such images overlap in a strip, which is better than no overlap
_FEW = 4
_PARTS = (1.0, 0.5, 0.25)


def neighbors(poses: NDArray[np.float64], frame: int, count: int, baseline: float, spread: float = 0.2) -> list[int]:
    """Indices of at most `count` frames that show the view of `frame` with parallax, best first.

    poses     (N, 4, 4) camera to world, meters
    baseline  best distance between the two cameras for the depths of the scene, meters
    spread    chosen frames are at least this share of `baseline` apart

    If a camera only turned in place, too few frames qualify. Then cameras at a half or a quarter of the baseline are
    used. If these are too few, cameras at twice the baseline and with larger viewing angles are added.
    """
    chosen: list[int] = []
    for part, degrees in [*((p, _DEGREES) for p in _PARTS), (2.0, _DEGREES), *((p, _WIDE) for p in (*_PARTS, 2.0))]:
        if (degrees > _DEGREES or part > 1) and len(chosen) >= _FEW:
            break
        score = _scores(poses, frame, part * baseline, degrees)
        for other in np.argsort(-score, kind="stable"):
            if score[other] <= 0 or len(chosen) >= count:
                break
            apart = [np.linalg.norm(poses[other, :3, 3] - poses[taken, :3, 3]) for taken in chosen]
            if all(length > part * spread * baseline for length in apart):
                chosen.append(int(other))
    return chosen


def _scores(poses: NDArray[np.float64], frame: int, baseline: float, degrees: float) -> NDArray[np.float64]:
    """(N,) score of each frame, 0 for unusable ones. Sideways parallax scores higher than parallax along the viewing
    direction, which vanishes in the middle of the image."""
    places, views = poses[:, :3, 3], poses[:, :3, 2]
    offset = places - places[frame]
    length = np.linalg.norm(offset, axis=1)
    turned = np.degrees(np.arccos(np.clip(views @ views[frame], -1, 1)))
    aside = np.linalg.norm(offset - (offset @ views[frame])[:, None] * views[frame], axis=1)
    with np.errstate(divide="ignore"):
        fit = np.exp(-(np.log(length / baseline) ** 2))
    score: NDArray[np.float64] = fit * (0.3 + np.minimum(aside / baseline, 1.0)) * np.cos(np.radians(turned))
    score[(length < 0.15 * baseline) | (length > 4 * baseline) | (turned > degrees)] = 0.0
    return score
