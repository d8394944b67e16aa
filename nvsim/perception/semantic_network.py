"""The semantic role, filled by a network that the user adds: floor, and people and objects if its classes include
them."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, level_rays
from nvsim.networks.chain import Chain, Values
from nvsim.networks.description import FloorResult
from nvsim.networks.image_preparation import Placement
from nvsim.perception.roles import Float32, Image


class SemanticNetwork:
    """A SemanticFloor from an opened model."""

    def __init__(self, chain: Chain) -> None:
        assert isinstance(chain.description.result, FloorResult)
        self._chain, self._result = chain, chain.description.result

    def floor_probability(self, image: Image, camera: Camera) -> Float32:
        """(H, W) float32, 0 to 1, see SemanticFloor."""
        shown = self._chain.show(image, partial(placed_rays, camera))
        found = self._chain.value(shown.values, self._result.value)
        place = shown.placements[self._result.image]
        if self._result.meaning == "labels":
            return _floor_share(self._planes(found, 1, shown.values)[0], self._result.floor, place)
        planes = self._planes(found, self._result.classes, shown.values)
        floor = _shift_classes(self._result.floor, len(planes) - self._result.classes)
        if self._result.meaning == "probabilities":
            return np.clip(place.to_image_size(planes[list(floor)].sum(axis=0)), 0, 1)
        if len(planes) == 1:
            return np.asarray(1 / (1 + np.exp(-np.clip(place.to_image_size(planes[0]), -80, 80))), np.float32)
        return _softmax(planes, floor, place)

    def people(self, image: Image) -> NDArray[np.bool_]:
        """(H, W) bool, True on people, for an image (H, W, 3) uint8 RGB.

        Raises InputError if the description lists no class of people, or if the model needs the camera of the image."""
        if not self._result.people:
            raise InputError(
                f"{self._chain.description.title} has no class of people; use another network, or list its classes of "
                "people in its description (people = [...])."
            )
        planes, place = self._seen_without_camera(image)
        if self._result.meaning == "labels":
            return _floor_share(planes[0], self._result.people, place) > 0.5
        people = list(_shift_classes(self._result.people, len(planes) - self._result.classes))
        if self._result.meaning == "probabilities":
            return place.to_image_size(planes[people].sum(axis=0)) > 0.5
        # Unlike that of floor, the softmax is enlarged: it takes a tenth of the time, and the mask is dilated anyway.
        likely = np.exp(planes - planes.max(axis=0))
        return place.to_image_size(likely[people].sum(axis=0) / likely.sum(axis=0)) > 0.5

    @property
    def object_names(self) -> tuple[str, ...]:
        """The names of the objects that the network knows."""
        return tuple(name for name, _ in self._result.objects)

    def objects(self, image: Image) -> NDArray[np.uint8]:
        """(H, W) uint8 for an image (H, W, 3) uint8 RGB: 1 and more is the object `object_names[value - 1]`, 0 is
        something else.

        Raises InputError if the description lists no objects, or if the model needs the camera of the image."""
        if not self._result.objects:
            raise InputError(
                f"{self._chain.description.title} names no objects; use another network, or list its classes of "
                "objects in its description ([result.objects])."
            )
        planes, place = self._seen_without_camera(image)
        if self._result.meaning == "labels":
            labels, background = np.rint(planes[0]).astype(np.int64), 0
        else:
            labels, background = planes.argmax(axis=0), len(planes) - self._result.classes
        numbers = np.zeros(self._result.classes + background, np.uint8)
        for number, (_, classes) in enumerate(self._result.objects, 1):
            numbers[list(_shift_classes(classes, background))] = number
        known = (labels >= 0) & (labels < len(numbers))
        named = np.where(known, numbers[np.where(known, labels, 0)], 0).astype(np.uint8)
        return np.asarray(place.nearest_at_image_size(named))

    def _seen_without_camera(self, image: Image) -> tuple[NDArray[np.float32], Placement]:
        """The planes of classes (C, h, w), or one plane of labels, and the position of the image in them."""
        shown = self._chain.show(image)
        found = self._chain.value(shown.values, self._result.value)
        classes = 1 if self._result.meaning == "labels" else self._result.classes
        return self._planes(found, classes, shown.values), shown.placements[self._result.image]

    def _planes(self, found: NDArray[np.float32], classes: int, values: Values) -> NDArray[np.float32]:
        """(C, h, w) with the described number of classes, or one more. Raises InputError for another number."""
        if self._result.scores and self._result.scores in values:
            masks = found.reshape(-1, *found.shape[-2:])
            scores = np.ravel(self._chain.value(values, self._result.scores))
            return masks[[int(np.argmax(scores))]] if len(scores) == len(masks) else masks[:1]
        planes = np.moveaxis(found, -1, -3) if self._result.channels_last and found.ndim > 2 else found
        planes = planes.reshape(-1, *planes.shape[-2:]) if planes.ndim >= 2 else planes[None, None]
        extra = (0, 1) if self._result.meaning != "labels" and classes > 1 else (0,)
        if len(planes) - classes not in extra:
            path = next(iter(self._chain.paths.values()))
            raise InputError(
                f"{path} gives {self._result.value} of the shape {list(found.shape)}, but its description says "
                f"{classes} class{'es' if classes != 1 else ''}; correct classes, floor or layout there."
            )
        return planes


def _shift_classes(classes: tuple[int, ...], background: int) -> tuple[int, ...]:
    """The numbers of `classes`, shifted by the number of `background` classes."""
    return tuple(number + background for number in classes)


def _softmax(planes: NDArray[np.float32], floor: tuple[int, ...], place: Placement) -> Float32:
    """(H, W) softmax of logits (C, h, w), summed over the classes `floor`, at the image's size. The logits are enlarged
    rather than their softmax, one class at a time, because 150 enlarged classes need much memory."""
    most = place.to_image_size(planes.max(axis=0))
    total, ours = np.zeros_like(most), np.zeros_like(most)
    for number, plane in enumerate(planes):
        part = np.exp(place.to_image_size(plane) - most)
        total += part
        if number in floor:
            ours += part
    return np.asarray(ours / np.maximum(total, 1e-30), np.float32)


def _floor_share(labels: NDArray[np.float32], floor: tuple[int, ...], place: Placement) -> Float32:
    """(H, W) 1 where `labels` (h, w) are floor, at the image's size; linear between labels."""
    return place.to_image_size(np.isin(np.round(labels), floor).astype(np.float32))


def placed_rays(camera: Camera, place: Placement) -> NDArray[np.float32]:
    """(1, 3, rows, columns) float32 unit vectors (right, down, forward) of the leveled `camera` for the pixels of the
    network's input. `place` is the position of the camera's image in it."""
    k = camera.intrinsics.scaled(place.wide, place.high)
    placed = Intrinsics(place.columns, place.rows, k.fx, k.fy, k.cx + place.left, k.cy + place.top)
    rays = level_rays(Camera(placed, camera.camera_to_world))
    return np.ascontiguousarray(rays.transpose(2, 0, 1)[None])
