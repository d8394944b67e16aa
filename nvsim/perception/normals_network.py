"""The role of surface normals by a network that the user brings: `normals.onnx` in the models folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.geometry.camera import Camera
from nvsim.perception.models import find_model, models_folder
from nvsim.perception.normals_form import form_of
from nvsim.perception.onnx_session import TYPES, session
from nvsim.perception.roles import Float32, Image

ROLE = "normals"
"""In the models folder: normals.onnx, and normals.toml where it is no known export."""
_FLOATS = ("tensor(float)", "tensor(float16)")
_MOST = 4096  # pixels of a side
_TOKENS = 1800  # MoGe's own default
_GREY = (0.485, 0.456, 0.406)  # the mean colour of ImageNet, which Metric3D is padded with
_THERE = 0.5  # where MoGe's mask is below, there is no surface


class NormalsNetwork:
    """An opened network. A SurfaceNormals, for images of any size.

    Raises InputError for a file that cannot be loaded, takes no single image, or is of an unknown form.
    """

    def __init__(self, path: Path) -> None:
        self._session, self._path = session(path), path
        inputs = self._session.get_inputs()
        images = [i for i in inputs if len(i.shape or ()) == 4 and i.type in _FLOATS]
        self._others = [i for i in inputs if i not in images]
        if len(images) != 1 or any(i.name != "num_tokens" or i.type not in TYPES for i in self._others):
            found = ", ".join(f"{i.name} {i.type} {i.shape}" for i in inputs)
            raise InputError(f"{path} takes {found}; a network of normals takes one image of shape (1, 3, H, W).")
        self._image = images[0]
        self._form = form_of(path, {i.name for i in inputs})
        height, width = self._image.shape[2:]
        fixed = isinstance(height, int) and isinstance(width, int)
        self._size = (width, height) if fixed else None
        if fixed and not all(1 <= n <= _MOST for n in (width, height)):
            raise InputError(f"{path} takes images of {width} x {height} pixels; export it with dynamic size.")

    def normals(self, image: Image, camera: Camera) -> Float32:
        """See SurfaceNormals."""
        found = self.seen(image) @ camera.rotation.T.astype(np.float32)
        return np.asarray(found, np.float32)

    def seen(self, image: Image) -> Float32:
        """(H, W, 3) float32, unit length, in the camera's frame (x right, y down, z forward), out of the surface
        towards the camera; zero where the network sees none. `image` (H, W, 3) uint8 RGB."""
        height, width = image.shape[:2]
        placed, (left, top, wide, high) = self._placed(image)
        with reading(self._path, "a network of normals that runs", "export it again"):
            normals, there = self._asked(placed)
            size = placed.shape[1], placed.shape[0]
            inside = slice(top, top + high), slice(left, left + wide)
            normals = _resized(_resized(normals, size)[inside], (width, height))
            length = np.linalg.norm(normals, axis=-1, keepdims=True)
            found = np.where(length > 1e-3, normals / np.maximum(length, 1e-3), 0).astype(np.float32)
            if there is not None:
                found[_resized(_resized(there, size)[inside], (width, height)) < _THERE] = 0
        return np.asarray(found, np.float32)

    def _placed(self, image: Image) -> tuple[Float32, tuple[int, int, int, int]]:
        """The image as the network's input, (h, w, 3) float32, and where in it the image lies: left, top, width,
        height. Its aspect ratio is kept, for stretching bends normals; around it is the mean colour."""
        import cv2

        height, width = image.shape[:2]
        form, many = self._form, self._form.multiple
        full = self._size or (-(-width // many) * many, -(-height // many) * many)
        scale = min(full[0] / width, full[1] / height) if self._size else 1.0
        wide, high = max(1, round(width * scale)), max(1, round(height * scale))
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        small = np.asarray(cv2.resize(image, (wide, high), interpolation=way), np.float32) * (form.white / 255)
        placed = np.tile(np.array(_GREY, np.float32) * form.white, (full[1], full[0], 1))
        left, top = (full[0] - wide) // 2, (full[1] - high) // 2
        placed[top : top + high, left : left + wide] = small
        normalised = (placed - np.array(form.mean)) / np.array(form.std)
        return normalised.astype(np.float32), (left, top, wide, high)

    def _asked(self, placed: Float32) -> tuple[Float32, Float32 | None]:
        """(h, w, 3) what the network says, not normalised, and its mask (h, w) where it gives one."""
        tensor = np.ascontiguousarray(placed.transpose(2, 0, 1)[None], TYPES[self._image.type])
        feed: dict[str, NDArray[Any]] = {self._image.name: tensor}
        for entry in self._others:
            feed[entry.name] = np.full((1,) * len(entry.shape or ()), _TOKENS, TYPES[entry.type])
        outputs = self._session.get_outputs()
        values = {o.name: np.asarray(v) for o, v in zip(outputs, self._session.run(None, feed), strict=True)}
        named = [v for n, v in values.items() if "normal" in n and "conf" not in n] or list(values.values())
        found = next((planes for planes in map(_planes, named) if planes is not None), None)
        if found is None:
            raise InputError(f"{self._path} gives no normals, three or four values for each pixel; export those too.")
        normals = found[..., :3].astype(np.float32)
        if self._form.halved:
            normals = 2 * normals - 1
        mask = values.get("mask")
        there = None if mask is None else np.ascontiguousarray(mask.reshape(mask.shape[-2:]), np.float32)
        return np.ascontiguousarray(normals * np.array(self._form.axes, np.float32)), there


def _resized(values: Float32, size: tuple[int, int]) -> Float32:
    """`values` (h, w) or (h, w, C) at a size, width and height in pixels."""
    import cv2

    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR), np.float32)


def _planes(value: NDArray[Any]) -> NDArray[Any] | None:
    """(h, w, C) of an output (1, C, h, w) or (1, h, w, C) with three or four channels, None where it is neither."""
    if value.ndim != 4 or len(value) != 1:
        return None
    if value.shape[1] in (3, 4):
        return value[0].transpose(1, 2, 0)
    return value[0] if value.shape[3] in (3, 4) else None


def normals_file() -> Path | None:
    """The user's network, None where there is none."""
    return find_model(ROLE)


def installed_normals() -> NormalsNetwork:
    """The user's network, opened. Raises InputError where there is none, or it is none."""
    path = normals_file()
    if path is None:
        raise InputError(
            f"No network of surface normals is installed; put one as {models_folder() / ROLE}.onnx, or ask for the "
            "Gaussians' normals (--normal-source gaussians)."
        )
    return NormalsNetwork(path)
