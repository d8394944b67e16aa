"""The prompted role by a network that the user brings: SAM 2 as its common exports have it, an encoder and a decoder.

Exports name and order things differently (image_embed, image_embeddings.0, ...), so features are recognised by their
channels, 32, 64 and 256, and everything else by what is common to the names. The image is stretched to the encoder's
size and normalised as ImageNet is; points are scaled alike (sam2/utils/transforms.py of facebookresearch/sam2).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.geometry.camera import Camera
from nvsim.perception.models import find_model, models_folder
from nvsim.perception.onnx_session import TYPES, session
from nvsim.perception.roles import Float32, Image, Mask

if TYPE_CHECKING:
    from onnxruntime import NodeArg

ENCODER, DECODER = "prompted.encoder", "prompted.decoder"
"""Roles in the models folder: prompted.encoder.onnx and prompted.decoder.onnx."""
_CHANNELS = (32, 64, 256)
_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
_STD = np.array([0.229, 0.224, 0.225], np.float32)
_LEAST, _MOST = 16, 4096  # pixels of the image that an encoder takes
_USUAL = 1024  # pixels, where an export leaves the size open


class PromptedNetwork:
    """An opened pair. A PromptedMask; remembers the features of the last image, so that further points cost only the
    decoder.

    Raises InputError for files that cannot be loaded or are no such pair.
    """

    def __init__(self, encoder: Path, decoder: Path) -> None:
        self._encoder, self._decoder = session(encoder), session(decoder)
        inputs = self._encoder.get_inputs()
        if len(inputs) != 1 or len(inputs[0].shape or ()) != 4 or inputs[0].type not in TYPES:
            raise InputError(f"{encoder} does not take one image of shape (1, 3, H, W); export the encoder of SAM 2.")
        height, width = (n if isinstance(n, int) else _USUAL for n in inputs[0].shape[2:])
        if not all(_LEAST <= n <= _MOST for n in (width, height)):
            raise InputError(f"{encoder} takes images of {width} x {height} pixels; export it for 1024 x 1024.")
        self._size = int(width), int(height)
        self._paths = encoder, decoder
        features = {i.shape[1] for i in self._decoder.get_inputs() if len(i.shape or ()) == 4}
        if not features.issuperset(_CHANNELS):
            raise InputError(
                f"{decoder} does not take the features of SAM 2 (with 32, 64 and 256 channels); export its decoder."
            )
        self._image: Image | None = None
        self._features: dict[int, Any] = {}

    def mask(self, picture: Image, points: NDArray[np.floating], camera: Camera) -> Mask:
        return self.region(picture, points, np.ones(len(points), bool))

    def region(self, image: Image, points: NDArray[np.floating], inside: NDArray[np.bool_]) -> Mask:
        """(H, W) bool: what holds the `points` (K, 2), x, y in pixels of `image` (H, W, 3) uint8 RGB, that are
        `inside` (K,), and not the others."""
        with reading(self._paths[0], "an encoder of SAM 2 that runs", "export it again"):
            self._look_at(image)
        with reading(self._paths[1], "a decoder of SAM 2 that runs", "export it again"):
            return self._decoded(image, points, inside)

    def _decoded(self, image: Image, points: NDArray[np.floating], inside: NDArray[np.bool_]) -> Mask:
        import cv2

        height, width = image.shape[:2]
        scaled = np.asarray(points * np.array([self._size[0] / width, self._size[1] / height]), np.float32)
        feed = {i.name: self._fed(i, scaled, inside, (height, width)) for i in self._decoder.get_inputs()}
        outputs = self._decoder.get_outputs()
        values = dict(zip((o.name for o in outputs), self._decoder.run(None, feed), strict=True))
        masks = next((v for n, v in values.items() if "mask" in n and "low" not in n), None)
        if masks is None or np.ndim(masks) < 2 or np.size(masks) == 0:
            raise InputError(f"{self._paths[1]} gives no masks; export the decoder of SAM 2 again.")
        scores = next((v for n, v in values.items() if "iou" in n or "score" in n), None)
        masks = np.asarray(masks, np.float32).reshape(-1, *masks.shape[-2:])
        # Of four the first is the one for unambiguous prompts; the paper's pipeline takes the best of the other three.
        first = 1 if len(masks) == 4 else 0
        best = first
        if scores is not None and np.size(scores) == len(masks):
            best = first + int(np.argmax(np.ravel(scores)[first:]))
        logits = cv2.resize(masks[best], (width, height), interpolation=cv2.INTER_LINEAR)
        found: Mask = np.asarray(logits) > 0
        return found

    def _look_at(self, image: Image) -> None:
        import cv2

        if self._image is not None and np.array_equal(self._image, image):
            return
        small = np.asarray(cv2.resize(image, self._size, interpolation=cv2.INTER_AREA), np.float32)
        values = ((small / 255 - _MEAN) / _STD).transpose(2, 0, 1)[None]
        entry = self._encoder.get_inputs()[0]
        found = self._encoder.run(None, {entry.name: np.ascontiguousarray(values, TYPES[entry.type])})
        self._features = {value.shape[1]: value for value in found if value.ndim == 4}
        self._image = image.copy()
        if not set(_CHANNELS) <= set(self._features):
            raise InputError("The prompted encoder gives no features with 32, 64 and 256 channels; export SAM 2 again.")

    def _fed(self, entry: NodeArg, points: Float32, inside: NDArray[np.bool_], size: tuple[int, int]) -> NDArray[Any]:
        """What one input of the decoder is given: `points` (K, 2) float32 in pixels of the encoder's image, `inside`
        (K,), `size` height and width of the image that is asked about."""
        kind, rank, name = TYPES.get(entry.type, np.float32), len(entry.shape or ()), entry.name
        value: NDArray[Any]
        if "box" in name:
            value = np.zeros((1, 0, 4))
        elif "has_mask" in name:
            value = np.zeros(1)
        elif "mask" in name:
            side = 4 * self._features[256].shape[-1]
            value = np.zeros((1, 1, side, side))
        elif "size" in name:
            value = np.array(size)
        elif "label" in name:
            value = inside.astype(np.float32).reshape((1,) * (rank - 1) + (-1,))
        elif "point" in name or "coord" in name:
            value = points.reshape((1,) * (rank - 2) + points.shape)
        else:
            value = self._features[entry.shape[1]]
        return np.ascontiguousarray(value, kind)


def prompted_files() -> tuple[Path, Path] | None:
    """The user's encoder and decoder, None where there is none. Raises InputError where there is only one of them."""
    encoder, decoder = find_model(ENCODER), find_model(DECODER)
    if encoder is None and decoder is None:
        return None
    if encoder is None or decoder is None:
        missing = ENCODER if encoder is None else DECODER
        raise InputError(f"{models_folder() / missing}.onnx is missing; a prompted model is an encoder and a decoder.")
    return encoder, decoder
