"""Converts the output of a renderer to displayed images, one for each channel."""

from __future__ import annotations

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
