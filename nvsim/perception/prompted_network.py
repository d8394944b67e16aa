"""The prompted role, filled by a network that the user adds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.geometry.camera import Camera
from nvsim.networks.chain import Chain, ProcessedImage, Values
from nvsim.networks.description import MaskResult, Points
from nvsim.networks.image_preparation import Placement
from nvsim.perception.roles import Image, Mask

_NO_POINT = -1.0  # label of a padding point


class PromptedNetwork:
    """A PromptedMask from an opened model. It keeps the image embedding of the last image, so that more points on that
    image cost little."""

    def __init__(self, chain: Chain) -> None:
        assert isinstance(chain.description.result, MaskResult)
        self._chain, self._result = chain, chain.description.result
        self._points = chain.description.points or Points()
        self._shown: ProcessedImage | None = None

    def mask(self, picture: Image, points: NDArray[np.floating], camera: Camera) -> Mask:
        """The region (H, W) bool of `picture` (H, W, 3) that contains the `points` (K, 2), see PromptedMask."""
        return self.region(picture, points, np.ones(len(points), bool))

    def region(self, image: Image, points: NDArray[np.floating], inside: NDArray[np.bool_]) -> Mask:
        """(H, W) bool: the region of `image` (H, W, 3) uint8 RGB that contains the `inside` points and not the others.
        `points` are (K, 2), x, y in pixels; `inside` is (K,) bool."""
        inside = np.asarray(inside, bool)
        if not self._points.negatives and not inside.all():
            kept = self.region(image, points[inside], inside[inside])
            return kept & ~self.region(image, points[~inside], ~inside[~inside])
        shown = self._shown  # another thread can replace it with another image meanwhile
        if shown is None or not np.array_equal(shown.image, image):
            shown = self._shown = self._chain.show(image.copy())
        placed = self._place_points(points, shown)
        labels = inside.astype(np.float32)
        if self._points.padding:
            placed, labels = np.vstack([placed, np.zeros((1, 2), np.float32)]), np.append(labels, _NO_POINT)
        values = self._chain.ask(shown, {"points": placed, "labels": labels})
        path = list(self._chain.paths.values())[-1]
        with reading(path, "a network that gives masks at points", "export it again"):
            return self._best(values, shown)

    def _place_points(self, points: NDArray[np.floating], shown: ProcessedImage) -> NDArray[np.float32]:
        if self._points.image:
            return shown.placements[self._points.image].points(points)
        return np.asarray(points, np.float32) - 0.5

    def _best(self, values: Values, shown: ProcessedImage) -> Mask:
        masks = self._chain.value(values, self._result.value)
        if masks.ndim < 2 or masks.size == 0:
            raise InputError(f"{list(self._chain.paths.values())[-1]} gives no masks; export it again.")
        masks = masks.reshape(-1, *masks.shape[-2:])
        first = 1 if len(masks) == 4 and self._result.single == "skip" else 0
        best = first
        scores = values.get(self._result.scores)
        if self._result.single != "first" and scores is not None and np.size(scores) == len(masks):
            best = first + int(np.argmax(np.ravel(scores)[first:]))
        height, width = shown.image.shape[:2]
        own = Placement(height, width, height, width, 0, 0, width, height)
        place = shown.placements[self._result.image] if self._result.image else own
        found: Mask = place.to_image_size(masks[best]) > 0
        return found
