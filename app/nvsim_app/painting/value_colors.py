"""Converts the output of a renderer to displayed images, one for each channel, and explains their colors. Does not use
Qt."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.render.backends import RenderOutput

CHANNELS = {
    "rgb": frozenset({"rgb"}),
    "alpha": frozenset({"alpha"}),
    "normal": frozenset({"normal", "alpha"}),
    "depth": frozenset({"depth", "alpha"}),
    "hole": frozenset({"rgb", "alpha"}),
    "submap": frozenset({"rgb", "alpha", "depth"}),
}
MEASURED = ("alpha", "depth", "normal")
"""The channels whose colors represent numbers."""
DEPTH_RANGE = (0.3, 20.0)  # meters, logarithmic, near is bright

# Ten anchors from dark blue over green to pale yellow, brightness rising throughout.
_RAMP = np.array(
    [
        (18, 20, 52), (35, 38, 102), (43, 68, 138), (40, 101, 150), (36, 133, 148),
        (45, 162, 136), (89, 189, 112), (154, 209, 86), (217, 223, 92), (252, 247, 190),
    ],
    np.float32,
)  # fmt: skip
HOLE = np.array([255, 64, 180], np.float32)
"""Color of pixels without Gaussians: the hole below the floor, and missing parts."""
_EMPTY = np.array([24, 26, 31], np.float32)


def ramp(share: NDArray[np.floating]) -> NDArray[np.float32]:
    """(..., 3) float32 RGB, 0 to 255, of values (...) from 0 to 1."""
    position = np.clip(share, 0, 1) * (len(_RAMP) - 1)
    low = np.minimum(position.astype(np.intp), len(_RAMP) - 2)
    part = (position - low)[..., None].astype(np.float32)
    return _RAMP[low] * (1 - part) + _RAMP[low + 1] * part


def measured(view: RenderOutput, channel: str) -> NDArray[np.float32] | None:
    """The numbers that `picture` shows: (H, W) alpha, (H, W) depth in meters, or (H, W, 3) normals. None for other
    channels."""
    values: NDArray[np.float32] | None = getattr(view, channel) if channel in MEASURED else None
    return values


def picture(view: RenderOutput, channel: str) -> NDArray[np.uint8]:
    """The image of a channel, (H, W, 4) uint8 (blue, green, red, 255). Raises ValueError if the channel was not
    rendered.

    "hole" needs a view without background. "submap" gives the brightness, which a Territory tints."""
    if channel == "rgb" and view.rgb is not None:
        rgb = view.rgb * np.float32(255)
    elif channel == "alpha" and view.alpha is not None:
        rgb = np.repeat(view.alpha[..., None] * np.float32(255), 3, axis=-1)
    elif channel == "normal" and view.normal is not None and view.alpha is not None:
        rgb = (view.normal * np.float32(0.5) + np.float32(0.5)) * np.float32(255)
        rgb = _over_empty(rgb, view.alpha)
    elif channel == "depth" and view.depth is not None and view.alpha is not None:
        low, high = np.log(DEPTH_RANGE)
        share = (np.log(np.maximum(view.depth, DEPTH_RANGE[0])) - low) / (high - low)
        rgb = _over_empty(ramp(1 - share), view.alpha)
    elif channel == "hole" and view.rgb is not None and view.alpha is not None:
        weight = np.clip(view.alpha, 0, 1)[..., None]
        rgb = view.rgb * np.float32(255) + (1 - weight) * HOLE
    elif channel == "submap" and view.rgb is not None:
        light = view.rgb @ np.array([0.299, 0.587, 0.114], np.float32)
        rgb = np.repeat(light[..., None] * np.float32(255), 3, axis=-1)
    else:
        raise ValueError(f"the channel {channel!r} was not rendered")
    result = np.empty((*rgb.shape[:2], 4), np.uint8)
    np.clip(rgb, 0, 255, out=rgb)
    result[..., :3] = rgb[..., ::-1]
    result[..., 3] = 255
    return result


def alpha_shown(pixel: NDArray[np.uint8]) -> float:
    """The alpha that a pixel (4,) of `picture` shows, with an accuracy of 1 / 255."""
    return float(pixel[0]) / 255


def normal_shown(pixel: NDArray[np.uint8], alpha: float) -> NDArray[np.float32]:
    """(3,) float32 normal that a pixel (4,) of `picture` shows at this `alpha`, with an accuracy of 0.004 / alpha.
    Zeros if alpha is below 0.1."""
    if alpha < 0.1:
        return np.zeros(3, np.float32)
    rgb = (pixel[2::-1].astype(np.float32) - (1 - alpha) * _EMPTY) / np.float32(alpha)
    return np.clip(rgb / np.float32(127.5) - 1, -1, 1).astype(np.float32)


def _over_empty(rgb: NDArray[np.float32], alpha: NDArray[np.float32]) -> NDArray[np.float32]:
    weight = np.clip(alpha, 0, 1)[..., None]
    return (rgb * weight + _EMPTY * (1 - weight)).astype(np.float32)


_STEPS = 64  # number of colors along a bar
_LEAST_NORMAL = 0.1  # length below which a mean normal has no direction
_COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
MOST_VIEWS = 8
"""Number of confirming images with the brightest color; more images have the same color."""


def _no_position(value: object) -> None:
    """The share of scales without a bar: always None."""


@dataclass(frozen=True, eq=False)
class ValueScale:
    """The scale of an image of numbers.

    title     the measured quantity and its unit
    words     formats a value with its unit
    share     maps a value to its position on the bar, 0 to 1, or to None
    colors    (N, 3) uint8 RGB along the bar, its left end first; empty if there are `swatches`
    marks     positions on the bar, 0 to 1, and the labels below them
    swatches  colors as RGB and the meaning of each
    """

    title: str
    words: Callable[[Any], str]  # Any: a number, or (3,) of a normal
    share: Callable[[Any], float | None] = _no_position
    colors: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    marks: tuple[tuple[float, str], ...] = ()
    swatches: tuple[tuple[tuple[int, int, int], str], ...] = ()


@dataclass(frozen=True, eq=False)
class ImageValues:
    """The numbers of an image, (H, W) or (H, W, 3), and their scale."""

    scale: ValueScale
    values: NDArray[Any]

    def value_at(self, x: float, y: float) -> Any:
        """The value at x, y in shares of the width and the height: a scalar or (3,). None outside the image."""
        height, width = self.values.shape[:2]
        if not (0 <= x < 1 and 0 <= y < 1):
            return None
        return self.values[int(y * height), int(x * width)]


def _bar(share: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.asarray(ramp(share), np.uint8)


_ALONG = np.linspace(0, 1, _STEPS)


def _depth_share(meters: float) -> float | None:
    near, far = DEPTH_RANGE
    return None if meters <= 0 else math.log(min(max(meters, near), far) / near) / math.log(far / near)


def _depth_words(meters: float) -> str:
    return "no depth" if meters <= 0 else f"{meters:.2f} m"


def _depth_marks() -> tuple[tuple[float, str], ...]:
    return tuple((_depth_share(m) or 0.0, f"{m:g}") for m in (DEPTH_RANGE[0], 1.0, 3.0, 8.0, DEPTH_RANGE[1]))


def _normal_words(normal: NDArray[np.floating]) -> str:
    length = float(np.linalg.norm(normal))
    if length < _LEAST_NORMAL:
        return "no normal"
    x, y, up = (float(v) / length for v in normal)
    if math.hypot(x, y) < 0.5:
        return f"normal up {up:.2f}"
    facing = _COMPASS[round(math.degrees(math.atan2(x, y)) / 45) % 8]
    return f"normal up {up:.2f}, faces {facing}"


def _confirmed_words(views: int) -> str:
    return "no depth" if views == 0 else f"confirmed by {views} image{'s' if views != 1 else ''}"


DEPTH = ValueScale("Depth, m", _depth_words, _depth_share, _bar(1 - _ALONG), _depth_marks())
ALPHA = ValueScale(
    "Alpha",
    lambda alpha: f"alpha {alpha:.2f}",
    lambda alpha: min(max(float(alpha), 0.0), 1.0),
    np.repeat((255 * _ALONG).astype(np.uint8)[:, None], 3, axis=1),
    ((0.0, "0 empty"), (0.5, "0.5"), (1.0, "1 solid")),
)
CONFIRMED = ValueScale(
    "Images that confirm the depth",
    lambda views: _confirmed_words(int(views)),
    lambda views: min(int(views) / MOST_VIEWS, 1.0) if views else None,
    _bar(_ALONG),
    ((0.0, "0"), (0.5, f"{MOST_VIEWS // 2}"), (1.0, f"{MOST_VIEWS} or more")),
)
NORMALS = ValueScale(
    "Normals",
    _normal_words,
    swatches=(
        ((127, 127, 255), "up"),
        ((127, 255, 127), "N"),
        ((255, 127, 127), "E"),
        ((127, 0, 127), "S"),
        ((0, 127, 127), "W"),
        ((127, 127, 0), "down"),
    ),
)
OF_CHANNEL = {"alpha": ALPHA, "depth": DEPTH, "normal": NORMALS}
"""The scales of the channels of a render whose pixels are measured values."""


def difference_scale(gain: float) -> ValueScale:
    """The scale of an image that shows differences of 0 to 255 gray levels, amplified by `gain`."""
    most = 255 / gain
    return ValueScale(
        "Difference, gray levels of 255",
        lambda off: f"difference {int(off)} of 255",
        lambda off: min(float(off) / most, 1.0),
        _bar(_ALONG),
        tuple((share, f"{share * most:.0f}") for share in (0.0, 0.5, 1.0)),
    )
