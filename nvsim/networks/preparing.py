"""From an image to what a network takes, and from what it gives back to the pixels of the image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.networks.toml_table import Table

Image = NDArray[np.uint8]
Resize = Literal["crop", "stretch", "corner", "centre"]
Colours = Literal["RGB", "BGR"]
Axes = Literal["NCHW", "NHWC", "HWC"]
Interpolation = Literal["bicubic", "linear", "area"]
MOST_PIXELS = 2048
"""Of a side."""


@dataclass(frozen=True)
class Placement:
    """Where an image of `height` x `width` pixels lies in one of `rows` x `columns` that a network looks at: its upper
    left corner at `left`, `top`, there `wide` x `high` pixels large."""

    height: int
    width: int
    rows: int
    columns: int
    left: int
    top: int
    wide: int
    high: int

    def points(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """`points` (K, 2), x, y in pixels of the image, the first pixel's centre at 0.5, as indices of pixels of the
        network's image: the first pixel's centre at 0, as SAM takes them."""
        factor = np.array([self.wide / self.width, self.high / self.height])
        placed = np.asarray(points, float) * factor + (self.left, self.top) - 0.5
        return placed.astype(np.float32)

    def back(self, values: NDArray[Any]) -> NDArray[np.float32]:
        """(..., height, width) of `values` (..., h, w) that cover the network's image, its borders cut off; linear
        between them."""
        h, w = values.shape[-2:]
        y = (self.top + (np.arange(self.height) + 0.5) * self.high / self.height) * h / self.rows - 0.5
        x = (self.left + (np.arange(self.width) + 0.5) * self.wide / self.width) * w / self.columns - 0.5
        # Half a pixel of the network's image beyond the border is the border's, and not the image's.
        y = _within(y, self.top * h / self.rows, (self.top + self.high) * h / self.rows)
        x = _within(x, self.left * w / self.columns, (self.left + self.wide) * w / self.columns)
        return _between(_between(np.asarray(values, np.float32), y, -2), x, -1)


def _within(at: NDArray[np.float64], first: float, last: float) -> NDArray[np.float64]:
    """Indices `at` of cells, none beyond those that lie wholly from `first` to `last`, where one does."""
    low, high = np.ceil(first - 1e-6), np.floor(last + 1e-6) - 1
    return np.clip(at, low, high) if high >= low else at


def _between(values: NDArray[np.float32], at: NDArray[np.float64], axis: int) -> NDArray[np.float32]:
    """`values` at the indices `at` of an axis, linear between, the outermost beyond the ends."""
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
    """height, width   pixels that the network takes; 0 where it takes any size: the image's own then, at most `longest`
    resize          "crop": enlarged or shrunk until it covers them, then the middle; "stretch": to exactly them;
                    "corner" and "centre": until it fits in, at the upper left or in the middle, `pad` beside it
    interpolation   between pixels; an image that shrinks is averaged over them first where it is "area"
    brightest       what 255 becomes: 1.0, or 255.0 where the mean is in grey levels
    mean, std       of the three colours, in the order of `colours`
    colours         the order of the colours
    layout          the order of the axes; HWC takes one image
    pad             what lies beside the image: red, green, blue, 0 to 255
    multiple        pixels that the sides are a multiple of, where the network takes any size
    longest         pixels of the longer side there; 0 for the image's own
    """

    height: int
    width: int
    resize: Resize = "crop"
    interpolation: Interpolation = "bicubic"
    brightest: float = 1.0
    mean: tuple[float, float, float] = (0.485, 0.456, 0.406)
    std: tuple[float, float, float] = (0.229, 0.224, 0.225)
    colours: Colours = "RGB"
    layout: Axes = "NCHW"
    pad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    multiple: int = 1
    longest: int = 0

    def __call__(self, image: Image) -> NDArray[np.float32]:
        """(3, height, width) or (height, width, 3) float32 of an image (H, W, 3) uint8, red, green, blue."""
        return self.placed(image)[0]

    def placed(self, image: Image) -> tuple[NDArray[np.float32], Placement]:
        """What the network takes of an image, as `__call__`, and where in it the image lies."""
        place = self.placement(*image.shape[:2])
        sized: NDArray[Any] = self._sized(image, place)
        if self.colours == "BGR":
            sized = sized[..., ::-1]
        scale = self.brightest / 255 / np.array(self.std)
        offset = np.array(self.mean) / np.array(self.std)
        values = sized * scale.astype(np.float32) - offset.astype(np.float32)
        return np.ascontiguousarray(values.transpose(2, 0, 1) if self.layout == "NCHW" else values), place

    def of_size(self, height: int, width: int) -> Preparation:
        """The same for a network that takes so many pixels; 0 leaves a side as it is."""
        return replace(self, height=height or self.height, width=width or self.width)

    def placement(self, height: int, width: int) -> Placement:
        """Where an image of this size comes to lie."""
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
        """An open side: a multiple, at which a stretched image changes least and a padded one has room."""
        steps = pixels / self.multiple
        whole = round(steps) if self.resize in ("stretch", "crop") else -int(-(steps - 1e-9) // 1)
        return max(1, whole) * self.multiple

    def _sized(self, image: Image, place: Placement) -> NDArray[Any]:
        import cv2

        how = {"bicubic": cv2.INTER_CUBIC, "linear": cv2.INTER_LINEAR, "area": cv2.INTER_AREA}[self.interpolation]
        size = place.wide, place.high
        height, width = image.shape[:2]
        if self.interpolation != "area" and size[0] < width and size[1] < height:
            # OpenCV reads only the nearest pixels, which makes stripes of fine texture: shrink by whole steps before.
            step = max(1, min(width // size[0], height // size[1]))
            image = np.asarray(cv2.resize(image, (width // step, height // step), interpolation=cv2.INTER_AREA))
        resized = np.asarray(cv2.resize(image, size, interpolation=how))
        if place.left <= 0 and place.top <= 0 and place.wide >= place.columns and place.high >= place.rows:
            return resized[-place.top :, -place.left :][: place.rows, : place.columns]
        canvas = np.tile(np.array(self.pad, np.float32), (place.rows, place.columns, 1))
        canvas[place.top : place.top + place.high, place.left : place.left + place.wide] = resized
        return canvas


def preparation_in(table: Table, needs_size: bool = True) -> Preparation:
    """What a table of a description says of an image. An open size, with `multiple` and `longest`, stands only where
    it is not needed. Raises InputError."""
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
        table.one_of("colours", get_args(Colours), Preparation.colours),
        table.one_of("layout", get_args(Axes) if open_size else ("NCHW", "NHWC"), Preparation.layout),
        table.three("pad", Preparation.pad),
        table.whole("multiple", 1024, 1) if open_size else 1,
        table.whole("longest", MOST_PIXELS, 0) if open_size else 0,
    )
