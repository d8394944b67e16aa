"""The role features, filled by a network that the user adds: it finds keypoints, and may match them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.networks.chain import Chain
from nvsim.networks.description import FeaturesResult
from nvsim.networks.image_preparation import Image, Placement
from nvsim.poses.features import BORDER, Features, match_features


class FeatureNetwork:
    """A FeatureFinder from an opened model. `name` is the name of the model."""

    def __init__(self, chain: Chain, name: str) -> None:
        assert isinstance(chain.description.result, FeaturesResult)
        self._chain, self._result, self.name = chain, chain.description.result, name

    def find(self, image: Image, most: int, usable: NDArray[np.bool_] | None = None) -> Features:
        """The `most` distinct features of `image` (H, W, 3) uint8 RGB on `usable` pixels (H, W).

        Raises InputError if the network gives keypoints, descriptors, and scores of different numbers."""
        shown = self._chain.show(image)
        keypoints = self._chain.value(shown.values, self._result.value).reshape(-1, 2)
        looks = self._chain.value(shown.values, self._result.descriptors)
        looks = looks.reshape(-1, looks.shape[-1])
        scores = -np.arange(len(keypoints), dtype=np.float32)
        if self._result.scores:
            scores = np.ravel(self._chain.value(shown.values, self._result.scores))
        if not len(keypoints) == len(looks) == len(scores):
            raise InputError(
                f"{next(iter(self._chain.paths.values()))} gives {len(keypoints)} keypoints, {len(looks)} descriptors "
                f"and {len(scores)} scores; correct the description."
            )
        places = _in_image(keypoints, shown.placements[self._result.image])
        order = np.argsort(-scores, kind="stable")
        order = order[_is_usable(places[order], image.shape[:2], usable)][:most]
        unit = looks[order] / np.maximum(np.linalg.norm(looks[order], axis=1, keepdims=True), 1e-9)
        height, width = image.shape[:2]
        matcher = self.match if self._result.matches else None
        return Features(places[order], unit.astype(np.float16), matcher, (width, height))

    def match(self, one: Features, other: Features) -> NDArray[np.int64]:
        """(M, 2) int64 pairs of features of two images, by the matcher of the model. Without one, nearest descriptors
        match. Raises InputError if the number of matches is wrong."""
        if not self._result.matches:
            return match_features(one, other)
        if not len(one) or not len(other):
            return np.zeros((0, 2), np.int64)
        given = {}
        for k, features in enumerate((one, other)):
            size = np.array(features.size, np.float32)
            places = (features.places - 0.5).astype(np.float32)
            given[f"keypoints_{k}"] = places[None]
            given[f"centered_{k}"] = (2 * places - size)[None] / size.max()
            given[f"descriptors_{k}"] = features.descriptors.astype(np.float32)[None]
            given[f"size_{k}"] = size[None]
        values = self._chain.ask(None, given)
        found = np.rint(self._chain.value(values, self._result.matches)).astype(np.int64)
        if found.ndim == 2 and found.shape[1] == 2:
            pairs = found
        else:
            each = found.ravel()
            if len(each) != len(one):
                raise InputError(
                    f"{next(iter(self._chain.paths.values()))} gives matches of the shape {list(found.shape)} for "
                    f"{len(one)} keypoints; correct the description."
                )
            pairs = np.stack([np.arange(len(each)), each], axis=1)
        good = (pairs >= 0).all(axis=1) & (pairs < (len(one), len(other))).all(axis=1)
        if self._result.match_scores:
            good &= np.ravel(self._chain.value(values, self._result.match_scores)) >= self._result.least
        return pairs[good]


def _in_image(keypoints: NDArray[np.float32], place: Placement) -> NDArray[np.float64]:
    """(N, 2) float64 pixels of the image, from keypoints of the network's image: pixels, or -1 to 1."""
    if len(keypoints) and np.abs(keypoints).max() <= 1:
        return place.image_points((keypoints + 1) / 2 * np.array([place.columns - 1, place.rows - 1]))
    return place.image_points(keypoints)


def _is_usable(
    places: NDArray[np.float64], size: tuple[int, ...], usable: NDArray[np.bool_] | None
) -> NDArray[np.bool_]:
    """(N,) bool, which `places` (N, 2) are in an image of `size` and not next to its border or to unusable pixels. The
    border of a padded image is an edge that moves with the camera."""
    mask = np.zeros((size[0] + 2, size[1] + 2), np.uint8)
    mask[1:-1, 1:-1] = 1 if usable is None else usable
    mask = np.asarray(cv2.erode(mask, np.ones((BORDER, BORDER), np.uint8)))
    x, y = np.clip(np.floor(places).astype(int) + 1, 0, (size[1] + 1, size[0] + 1)).T
    return np.asarray(mask[y, x] > 0)
