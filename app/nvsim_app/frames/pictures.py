"""Converts arrays to images for Qt: photos, renders, masks, normals, depth, and differences of render and photo."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtGui import QColor, QImage

from nvsim_app.frames.correction import Box, Mask
from nvsim_app.painting.value_colors import (
    CONFIRMED,
    DEPTH,
    DEPTH_RANGE,
    MOST_VIEWS,
    NORMALS,
    OF_CHANNEL,
    ImageValues,
    difference_scale,
    ramp,
)

_RGB32 = QImage.Format.Format_RGB32


class PaintedImage:
    """An image with the memory that it uses: pixels (H, W) uint32, 0xAARRGGBB, premultiplied. If the colors represent
    numbers, `reading` has them."""

    def __init__(self, pixels: NDArray[np.uint32], opaque: bool, reading: ImageValues | None = None) -> None:
        self.reading = reading
        self.pixels = np.ascontiguousarray(pixels)
        height, width = self.pixels.shape
        kind = _RGB32 if opaque else QImage.Format.Format_ARGB32_Premultiplied
        self.image = QImage(self.pixels.data, width, height, 4 * width, kind)
        self._smaller: tuple[tuple[int, int], QImage] | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.image.width(), self.image.height()

    def scaled_down(self, width: int, height: int) -> QImage:
        """The image, smoothly scaled to this size if it is much larger, because painting it reduced would drop pixels.
        The last result is cached."""
        if width * 1.5 > self.image.width():
            return self.image
        if self._smaller is None or self._smaller[0] != (width, height):
            from PySide6.QtCore import Qt

            mode, smooth = Qt.AspectRatioMode.IgnoreAspectRatio, Qt.TransformationMode.SmoothTransformation
            self._smaller = (width, height), self.image.scaled(max(1, width), max(1, height), mode, smooth)
        return self._smaller[1]


def photo(image: NDArray[np.uint8]) -> PaintedImage:
    """A photo (H, W, 3) uint8 RGB as an image."""
    pixels = np.empty((*image.shape[:2], 4), np.uint8)
    for channel in range(3):
        pixels[..., channel] = image[..., 2 - channel]
    pixels[..., 3] = 255
    return PaintedImage(pixels.view(np.uint32)[..., 0], opaque=True)


def render(pixels: NDArray[np.uint8], channel: str = "rgb", values: NDArray[np.float32] | None = None) -> PaintedImage:
    """A render (H, W, 4) uint8 (blue, green, red, 255, as in Picture) as an image, with the numbers of its channel."""
    reading = None if values is None else ImageValues(OF_CHANNEL[channel], values)
    return PaintedImage(np.ascontiguousarray(pixels).view(np.uint32)[..., 0], opaque=True, reading=reading)


def tint(mask: Mask, color: str) -> PaintedImage:
    """`mask` (H, W) bool in one color, transparent outside the mask."""
    return PaintedImage(_two_tones(color)[mask.view(np.uint8)], opaque=False)


def repaint_mask(painted: PaintedImage, mask: Mask, color: str, box: Box) -> None:
    """Updates the pixels of `box` after `mask` (H, W) changed there."""
    painted.pixels[box.slices] = _two_tones(color)[mask[box.slices].view(np.uint8)]


def _two_tones(color: str) -> NDArray[np.uint32]:
    return np.array([0, QColor(color).rgba()], np.uint32)


def normals(values: NDArray[np.float32]) -> PaintedImage:
    """Normals (H, W, 3) float32 as colors; zero normals are transparent."""
    known = (np.abs(values).sum(axis=-1) > 0.1).astype(np.uint32)
    wide = np.clip((values + 1) * 127.5, 0, 255).astype(np.uint32)
    pixels = known * (0xFF000000 | wide[..., 0] << 16 | wide[..., 1] << 8 | wide[..., 2])
    return PaintedImage(pixels, opaque=False, reading=ImageValues(NORMALS, values))


def depth(meters: NDArray[np.float32]) -> PaintedImage:
    """Depth (H, W) float32 in meters with the colors of the 3D view; depth 0 is transparent."""
    near, far = DEPTH_RANGE
    known = meters > 0
    share = np.log(far / np.clip(np.where(known, meters, far), near, far)) / np.log(far / near)
    return _ramped(share, known, ImageValues(DEPTH, meters))


def confidence(views: NDArray[np.uint8]) -> PaintedImage:
    """Counts of views (H, W) uint8 from dark to bright; 0 is transparent."""
    return _ramped(views / MOST_VIEWS, views > 0, ImageValues(CONFIRMED, views))


def _ramped(share: NDArray[np.floating], known: NDArray[np.bool_], reading: ImageValues) -> PaintedImage:
    rgb = ramp(share).astype(np.uint32)
    pixels = 0xFF000000 | rgb[..., 0] << 16 | rgb[..., 1] << 8 | rgb[..., 2]
    return PaintedImage((known.astype(np.uint32) * pixels).astype(np.uint32), opaque=False, reading=reading)


def difference(photographed: PaintedImage, rendered: PaintedImage, gain: float) -> PaintedImage:
    """The largest difference of the three color channels, times `gain`, from dark to bright, at the render's size."""
    from PySide6.QtCore import Qt

    width, height = rendered.size
    mode, smooth = Qt.AspectRatioMode.IgnoreAspectRatio, Qt.TransformationMode.SmoothTransformation
    scaled = photographed.scaled_down(width, height).scaled(width, height, mode, smooth).convertToFormat(_RGB32)
    a = np.frombuffer(scaled.constBits(), np.uint8).reshape(height, scaled.bytesPerLine() // 4, 4)[:, :width]
    b = rendered.pixels.view(np.uint8).reshape(height, width, 4)
    off = np.maximum(a, b) - np.minimum(a, b)
    most = np.maximum(np.maximum(off[..., 0], off[..., 1]), off[..., 2])
    colors = ramp(np.clip(np.arange(256) * (gain / 255), 0, 1)).astype(np.uint32)
    table = 0xFF000000 | colors[:, 0] << 16 | colors[:, 1] << 8 | colors[:, 2]
    return PaintedImage(table.astype(np.uint32)[most], opaque=True, reading=ImageValues(difference_scale(gain), most))
