"""Convert an image to the input of a network, and the output of a network back to the pixels of the image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.networks.toml_table import TomlTable

Image = NDArray[np.uint8]
Resize = Literal["crop", "stretch", "corner", "centre"]
Colors = Literal["RGB", "BGR"]
Axes = Literal["NCHW", "NHWC", "HWC"]
Interpolation = Literal["bicubic", "linear", "area"]
MOST_PIXELS = 2048
"""Upper limit of a side in pixels."""


@dataclass(frozen=True)
class Placement:
    """The position of an image of `height` x `width` pixels in a network's image of `rows` x `columns` pixels.

    Its upper left corner is at `left`, `top`, and it is `wide` x `high` pixels large there."""

    height: int
    width: int
    rows: int
    columns: int
    left: int
    top: int
    wide: int
    high: int

    def points(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """(K, 2) float32 pixel indices in the network's image: the center of the first pixel is at 0, as in SAM.

        `points` (K, 2) are x, y in pixels of the image: the center of the first pixel is at 0.5."""
        factor = np.array([self.wide / self.width, self.high / self.height])
        placed = np.asarray(points, float) * factor + (self.left, self.top) - 0.5
        return placed.astype(np.float32)

    def image_points(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """(K, 2) float64 pixels of the image, from pixel indices (K, 2) in the network's image: inverse of `points`."""
        factor = np.array([self.wide / self.width, self.high / self.height])
        return np.asarray((np.asarray(points, float) + 0.5 - (self.left, self.top)) / factor)

    def to_image_size(self, values: NDArray[Any]) -> NDArray[np.float32]:
        """(..., height, width) float32 from `values` (..., h, w) that cover the network's image. Padding is cut off,
        and values are interpolated linearly."""
        y, x = self._cells(*values.shape[-2:])
        return _interpolate_axis(_interpolate_axis(np.asarray(values, np.float32), y, -2), x, -1)

    def nearest_at_image_size(self, values: NDArray[Any]) -> NDArray[Any]:
        """(height, width) entries of `values` (h, w), which cover the network's image. Padding is cut off."""
        y, x = (np.rint(at).astype(int).clip(0, n - 1) for at, n in zip(self._cells(*values.shape), values.shape))
        return values[np.ix_(y, x)]

    def _cells(self, h: int, w: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Rows (height,) and columns (width,) of the image's pixels in an array (h, w) that covers the network's
        image."""
        y = (self.top + (np.arange(self.height) + 0.5) * self.high / self.height) * h / self.rows - 0.5
        x = (self.left + (np.arange(self.width) + 0.5) * self.wide / self.width) * w / self.columns - 0.5
        # The outer half pixel of the network's image belongs to the padding, not to the image.
        y = _clip_cells(y, self.top * h / self.rows, (self.top + self.high) * h / self.rows)
        x = _clip_cells(x, self.left * w / self.columns, (self.left + self.wide) * w / self.columns)
        return y, x


def _clip_cells(at: NDArray[np.float64], first: float, last: float) -> NDArray[np.float64]:
    """Indices `at` of cells, clipped to the cells that are fully between `first` and `last`, if there are any."""
    low, high = np.ceil(first - 1e-6), np.floor(last + 1e-6) - 1
    return np.clip(at, low, high) if high >= low else at


def _interpolate_axis(values: NDArray[np.float32], at: NDArray[np.float64], axis: int) -> NDArray[np.float32]:
    """`values` at the fractional indices `at` of an axis: linear in between, constant beyond the ends."""
    last = values.shape[axis] - 1
    at = np.clip(at, 0, last)
    low = np.floor(at).astype(int)
    share = (at - low).astype(np.float32)
    if axis == -2:
        share = share[:, None]
    below, above = np.take(values, low, axis), np.take(values, np.minimum(low + 1, last), axis)
    return np.asarray(below + (above - below) * share, np.float32)


@dataclass(frozen=True)
class Preparation:
    """height, width   size in pixels that the network requires; 0 if it accepts any size: then the image's own size, at
                    most `longest`
    resize          "crop": scale until the image covers the size, then take the middle; "stretch": scale to the exact
                    size; "corner" and "centre": scale until the image fits, at the upper left or in the middle, with
                    `pad` beside it
    interpolation   between pixels; with "area", an image that shrinks is averaged first
    brightest       the value of 255: 1.0, or 255.0 if `mean` is in gray levels
    mean, std       of the three colors, in the order of `colors`
    colors          order of the colors
    layout          order of the axes; HWC takes one image
    pad             color beside the image: red, green, blue, 0 to 255
    multiple        the sides are multiples of this number of pixels, if the network accepts any size
    longest         pixels of the longer side in that case; 0 for the size of the image
    """

    height: int
    width: int
    resize: Resize = "crop"
    interpolation: Interpolation = "bicubic"
    brightest: float = 1.0
    mean: tuple[float, float, float] = (0.485, 0.456, 0.406)
    std: tuple[float, float, float] = (0.229, 0.224, 0.225)
    colors: Colors = "RGB"
    layout: Axes = "NCHW"
    pad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    multiple: int = 1
    longest: int = 0

    def __call__(self, image: Image) -> NDArray[np.float32]:
        """(3, height, width) or (height, width, 3) float32, from an image (H, W, 3) uint8 RGB."""
        return self.placed(image)[0]

    def placed(self, image: Image) -> tuple[NDArray[np.float32], Placement]:
        """The network's input for an image (H, W, 3) uint8 RGB, shaped as in `__call__`, and the position of the image
        in it."""
        place = self.placement(*image.shape[:2])
        sized: NDArray[Any] = self._resize(image, place)
        if self.colors == "BGR":
            sized = sized[..., ::-1]
        scale = self.brightest / 255 / np.array(self.std)
        offset = np.array(self.mean) / np.array(self.std)
        values = sized * scale.astype(np.float32) - offset.astype(np.float32)
        return np.ascontiguousarray(values.transpose(2, 0, 1) if self.layout == "NCHW" else values), place

    def of_size(self, height: int, width: int) -> Preparation:
        """This preparation for a network that requires `height` x `width` pixels; 0 keeps a side."""
        return replace(self, height=height or self.height, width=width or self.width)

    def placement(self, height: int, width: int) -> Placement:
        """The position of an image of `height` x `width` pixels in the network's image."""
        scale = self.longest / max(height, width) if self.longest else 1.0
        rows, columns = self.height or self._side(height * scale), self.width or self._side(width * scale)
        if self.resize == "stretch":
            return Placement(height, width, rows, columns, 0, 0, columns, rows)
        if self.resize == "crop":
            factor = max(rows / height, columns / width)
            high, wide = max(rows, round(height * factor)), max(columns, round(width * factor))
            return Placement(height, width, rows, columns, -((wide - columns) // 2), -((high - rows) // 2), wide, high)
        factor = min(rows / height, columns / width)
        if not (self.height and self.width):
            factor = min(factor, scale)
        high, wide = max(1, min(rows, round(height * factor))), max(1, min(columns, round(width * factor)))
        left, top = ((columns - wide) // 2, (rows - high) // 2) if self.resize == "centre" else (0, 0)
        return Placement(height, width, rows, columns, left, top, wide, high)

    def _side(self, pixels: float) -> int:
        """The length of a dynamic side: a multiple. A stretched image changes least at it; a padded image fits."""
        steps = pixels / self.multiple
        whole = round(steps) if self.resize in ("stretch", "crop") else -int(-(steps - 1e-9) // 1)
        return max(1, whole) * self.multiple

    def _resize(self, image: Image, place: Placement) -> NDArray[Any]:
        import cv2

        how = {"bicubic": cv2.INTER_CUBIC, "linear": cv2.INTER_LINEAR, "area": cv2.INTER_AREA}[self.interpolation]
        size = place.wide, place.high
        height, width = image.shape[:2]
        if self.interpolation != "area" and size[0] < width and size[1] < height:
            # OpenCV interpolates only the nearest pixels, which aliases fine texture. So first shrink by whole factors.
            step = max(1, min(width // size[0], height // size[1]))
            image = np.asarray(cv2.resize(image, (width // step, height // step), interpolation=cv2.INTER_AREA))
        resized = np.asarray(cv2.resize(image, size, interpolation=how))
        if place.left <= 0 and place.top <= 0 and place.wide >= place.columns and place.high >= place.rows:
            return resized[-place.top :, -place.left :][: place.rows, : place.columns]
        canvas = np.tile(np.array(self.pad, np.float32), (place.rows, place.columns, 1))
        canvas[place.top : place.top + place.high, place.left : place.left + place.wide] = resized
        return canvas


def preparation_in(table: TomlTable, needs_size: bool = True) -> Preparation:
    """The preparation that a table of a description defines. A dynamic size, with `multiple` and `longest`, is allowed
    only if `needs_size` is False. Raises InputError if a value is wrong."""
    height, width = table.size(MOST_PIXELS, None if needs_size else (0, 0))
    open_size = needs_size is False
    return Preparation(
        height,
        width,
        table.one_of("resize", get_args(Resize), Preparation.resize),
        table.one_of("interpolation", get_args(Interpolation), Preparation.interpolation),
        table.number("brightest", Preparation.brightest),
        table.three("mean", Preparation.mean),
        table.three("std", Preparation.std, positive=True),
        table.one_of("colours", get_args(Colors), Preparation.colors),
        table.one_of("layout", get_args(Axes) if open_size else ("NCHW", "NHWC"), Preparation.layout),
        table.three("pad", Preparation.pad),
        table.integer("multiple", 1024, 1) if open_size else 1,
        table.integer("longest", MOST_PIXELS, 0) if open_size else 0,
    )
