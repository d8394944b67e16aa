"""From an image to what a network takes: resized, cropped, scaled, in the network's order of axes and colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.features.backbone import Image

Resize = Literal["crop", "stretch"]
Colours = Literal["RGB", "BGR"]
Axes = Literal["NCHW", "NHWC"]
Interpolation = Literal["bicubic", "linear", "area"]


@dataclass(frozen=True)
class Preparation:
    """height, width   pixels that the network takes
    resize          "crop": enlarged or shrunk until it covers them, then the middle; "stretch": to exactly them
    interpolation   between pixels; an image that shrinks is averaged over them first where it is "area"
    brightest       what 255 becomes: 1.0, or 255.0 where the mean is in grey levels
    mean, std       of the three colours, in the order of `colours`
    colours         the order of the colours
    layout          the order of the axes
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

    def __call__(self, image: Image) -> NDArray[np.float32]:
        """(3, height, width) or (height, width, 3) float32 of an image (H, W, 3) uint8, red, green, blue."""
        sized = self._sized(image)
        if self.colours == "BGR":
            sized = sized[..., ::-1]
        scale = self.brightest / 255 / np.array(self.std)
        offset = np.array(self.mean) / np.array(self.std)
        values = sized * scale.astype(np.float32) - offset.astype(np.float32)
        return np.ascontiguousarray(values.transpose(2, 0, 1) if self.layout == "NCHW" else values)

    def _sized(self, image: Image) -> NDArray[Any]:
        import cv2

        how = {"bicubic": cv2.INTER_CUBIC, "linear": cv2.INTER_LINEAR, "area": cv2.INTER_AREA}[self.interpolation]
        height, width = image.shape[:2]
        if self.resize == "crop":
            factor = max(self.height / height, self.width / width)
            size = max(self.width, round(width * factor)), max(self.height, round(height * factor))
        else:
            size = self.width, self.height
        if self.interpolation != "area" and size[0] < width and size[1] < height:
            # OpenCV reads only the nearest pixels, which makes stripes of fine texture: shrink by whole steps before.
            step = max(1, min(width // size[0], height // size[1]))
            image = np.asarray(cv2.resize(image, (width // step, height // step), interpolation=cv2.INTER_AREA))
        resized = np.asarray(cv2.resize(image, size, interpolation=how))
        top, left = (size[1] - self.height) // 2, (size[0] - self.width) // 2
        return resized[top : top + self.height, left : left + self.width]
