"""Camera models of images as stored, and the conversion to the pinhole camera that all other code uses.

Names and parameter order are COLMAP's (colmap.github.io/cameras.html), which kapture shares. nerfstudio's OPENCV and
OPENCV_FISHEYE map to them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Intrinsics, quarter_turns

Scalar = TypeVar("Scalar", bound=np.generic)

PARAMETER_COUNTS = {
    "SIMPLE_PINHOLE": 3,
    "PINHOLE": 4,
    "SIMPLE_RADIAL": 4,
    "RADIAL": 5,
    "OPENCV": 8,
    "OPENCV_FISHEYE": 8,
    "FULL_OPENCV": 12,
    "SIMPLE_RADIAL_FISHEYE": 4,
    "RADIAL_FISHEYE": 5,
}
_ONE_FOCAL = {"SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"}


@dataclass(frozen=True)
class Lens:
    """A camera model: name from PARAMETER_COUNTS, image size in pixels, parameters in COLMAP's order.

    `turns` is the number of counterclockwise quarter turns that make the stored image upright. `border` is the width in
    pixels of its border without content: left, top, right, bottom. Size and parameters belong to the stored image, the
    pinhole camera and its pose to the upright one without the border.

    Raises ValueError for an unknown model, a wrong parameter count, parameters that are not finite, or a border that
    leaves no image.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]
    turns: int = 0
    border: tuple[int, int, int, int] = (0, 0, 0, 0)

    def __post_init__(self) -> None:
        if self.model not in PARAMETER_COUNTS:
            known = ", ".join(PARAMETER_COUNTS)
            raise ValueError(f"camera model {self.model!r} is not supported (supported: {known})")
        if len(self.params) != PARAMETER_COUNTS[self.model]:
            raise ValueError(
                f"camera model {self.model} takes {PARAMETER_COUNTS[self.model]} parameters, got {len(self.params)}"
            )
        if self.turns not in range(4):
            raise ValueError(f"{self.turns} quarter turns are not 0 to 3")
        if self.width <= 0 or self.height <= 0:
            raise ValueError(f"image size {self.width}x{self.height} is not positive")
        left, top, right, bottom = self.border
        if min(self.border) < 0 or left + right >= self.width or top + bottom >= self.height:
            raise ValueError(f"a border of {self.border} pixels leaves no image of {self.width}x{self.height}")
        if not np.isfinite(self.params).all() or self.focal[0] <= 0 or self.focal[1] <= 0:
            raise ValueError(f"camera parameters {self.params} are not finite with positive focal lengths")

    @property
    def focal(self) -> tuple[float, float]:
        return (self.params[0], self.params[0]) if self.model in _ONE_FOCAL else (self.params[0], self.params[1])

    @property
    def principal_point(self) -> tuple[float, float]:
        start = 1 if self.model in _ONE_FOCAL else 2
        return self.params[start], self.params[start + 1]

    @property
    def distortion(self) -> tuple[float, ...]:
        return self.params[3:] if self.model in _ONE_FOCAL else self.params[4:]

    @property
    def is_fisheye(self) -> bool:
        return "FISHEYE" in self.model

    @property
    def is_distorted(self) -> bool:
        return self.is_fisheye or any(abs(k) > 1e-12 for k in self.distortion)

    def resized(self, width: int, height: int) -> Lens:
        """The lens if its images are stored at another size in pixels. Distortion applies to normalized coordinates, so
        it does not change. A single focal length is scaled by the geometric mean of both sides. The border is rounded
        up."""
        x, y = width / self.width, height / self.height
        cx, cy = self.principal_point
        focal = (
            (self.focal[0] * (x * y) ** 0.5,) if self.model in _ONE_FOCAL else (self.focal[0] * x, self.focal[1] * y)
        )
        left, top, right, bottom = (math.ceil(b * s - 1e-9) for b, s in zip(self.border, (x, y, x, y), strict=True))
        params = (*focal, cx * x, cy * y, *self.distortion)
        return replace(self, width=width, height=height, params=params, border=(left, top, right, bottom))

    def upright(self, stored: NDArray[Scalar]) -> NDArray[Scalar]:
        """A stored image (H, W, ...) of any size without its border, upright. Distortion remains."""
        height, width = stored.shape[:2]
        left, top, right, bottom = self.border
        rows = slice(round(top * height / self.height), round((self.height - bottom) * height / self.height))
        columns = slice(round(left * width / self.width), round((self.width - right) * width / self.width))
        return np.rot90(stored[rows, columns], self.turns)

    @cached_property
    def pinhole(self) -> Intrinsics:
        """The pinhole camera of the undistorted, upright image. Apart from border and turns, its size and principal
        point are those of the stored image.

        The focal lengths are kept if this leaves no pixel in the border or outside the stored image. Otherwise both are
        enlarged by the smallest sufficient factor."""
        (fx, fy), (cx, cy) = self.focal, self.principal_point
        zoom = 1.0 if not self.is_distorted or self._sees_only_stored_pixels(1.0) else self._least_zoom()
        left, top, right, bottom = self.border
        width, height = self.width - left - right, self.height - top - bottom
        return Intrinsics(width, height, fx * zoom, fy * zoom, cx - left, cy - top).turned(self.turns)

    def _least_zoom(self) -> float:
        low, high = 1.0, 4.0
        for _ in range(20):
            middle = (low + high) / 2
            low, high = (low, middle) if self._sees_only_stored_pixels(middle) else (middle, high)
        return high

    def _sees_only_stored_pixels(self, zoom: float) -> bool:
        """Whether the pinhole camera with focal lengths times `zoom` sees only pixels inside the border.

        Along rays from the principal point to the border, the samples must move outward (a polynomial may turn back
        outside its range) and stay inside the image."""
        (fx, fy), (cx, cy) = self.focal, self.principal_point
        t = np.linspace(0, 1, 33)
        left, top, right, bottom = self.border
        low, high = np.array([left, top], float), np.array([self.width - right, self.height - bottom], float)
        corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        border = (corners[:, None] * (1 - t[:, None]) + np.roll(corners, -1, axis=0)[:, None] * t[:, None]).reshape(
            -1, 2
        )
        ends = (border - (cx, cy)) / (fx * zoom, fy * zoom)
        samples = self.distort(ends[:, None] * t[:, None])
        outwards = np.linalg.norm(samples - (cx, cy), axis=-1)
        inside = (samples > low - 0.5).all() and (samples < high + 0.5).all()
        return bool(inside and (np.diff(outwards, axis=1) > -1e-9).all())

    def distort(self, normalized: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (..., 2) float64 in the stored image, from undistorted normalized coordinates (..., 2)."""
        x, y = normalized[..., 0], normalized[..., 1]
        k = self.distortion
        if self.is_fisheye:
            r = np.hypot(x, y)
            theta = np.arctan(r)
            t2 = theta * theta
            series = 1.0 + sum((c * t2 ** (i + 1) for i, c in enumerate(k)), np.zeros_like(t2))
            scale = np.where(r > 1e-9, theta * series / np.maximum(r, 1e-9), 1.0)
            xd, yd = x * scale, y * scale
        else:
            r2 = x * x + y * y
            k1 = k[0] if len(k) > 0 else 0.0
            k2 = k[1] if len(k) > 1 else 0.0
            p1, p2 = (k[2], k[3]) if len(k) >= 4 else (0.0, 0.0)
            radial = 1 + k1 * r2 + k2 * r2**2
            if len(k) == 8:
                radial = (radial + k[4] * r2**3) / (1 + k[5] * r2 + k[6] * r2**2 + k[7] * r2**3)
            xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
            yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        (fx, fy), (cx, cy) = self.focal, self.principal_point
        return np.stack([fx * xd + cx, fy * yd + cy], axis=-1)

    def undistort_map(self, target: Intrinsics) -> NDArray[np.float32]:
        """(H, W, 2) float32: sampling position in the stored image for each pixel of the upright camera `target`, in
        OpenCV's remap convention (pixel centers at integers)."""
        u = (np.arange(target.width) + 0.5 - target.cx) / target.fx
        v = (np.arange(target.height) + 0.5 - target.cy) / target.fy
        grid = np.stack(np.meshgrid(u, v), axis=-1) @ quarter_turns(self.turns)[:2, :2]
        return (self.distort(grid) - 0.5).astype(np.float32)
