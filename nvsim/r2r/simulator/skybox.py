"""Finds, decodes, checks and caches the skybox strips of viewpoints, and computes the rays of views."""

from __future__ import annotations

import math
import os
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.images import decoded, is_cut_off
from nvsim.files.opening import read_bytes
from nvsim.geometry.camera import look
from nvsim.graph.connectivity import FOLDER, SkyboxFiles
from nvsim.r2r.simulator.conventions import InvalidValue

_THEN = "export the scan again"
_SHARED: WeakValueDictionary[tuple[str, int, int], NDArray[Any]] = WeakValueDictionary()
"""Strips in use by any simulator of this process, because the simulators of a batch often use the same images."""


def rays_of(
    rotation: NDArray[np.float64], heading: float, elevation: float, width: int, height: int, vfov: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Computes the rays of a view in the frame of a pose with camera-to-world rotation (3, 3); angles in radians.

    The first result is (3, 3) float32: the ray through the first pixel, and the changes per pixel to the right and
    down. The second is (4,) float32 in the plane at depth 1: x and y of the first pixel, and their changes per pixel.
    """
    tangent = math.tan(vfov / 2)
    pixel = 2 * tangent / height
    plane = np.array([(0.5 - width / 2) * pixel, (0.5 - height / 2) * pixel, pixel, pixel])
    view = np.linalg.inv(rotation) @ look(np.zeros(3), heading, elevation)[:3, :3]
    first = view @ np.array([plane[0], plane[1], 1.0])
    return np.stack([first, view[:, 0] * pixel, view[:, 1] * pixel]).astype(np.float32), plane.astype(np.float32)


class StripCache:
    """A thread-safe cache of the last used strips of a folder `<scan>/matterport_skybox_images/`.

    It has at most `size` decoded strips of each kind, and all preloaded ones.
    """

    def __init__(self, folder: Path | str, size: int) -> None:
        self._folder, self._size = Path(folder), max(1, size)
        self._lock = threading.Lock()
        self._used: dict[str, OrderedDict[tuple[str, str], NDArray[Any]]] = {
            "rgb": OrderedDict(),
            "depth": OrderedDict(),
        }
        self._preloaded: dict[tuple[str, str, str], NDArray[Any]] = {}

    def colours(self, scan: str, viewpoint: str) -> NDArray[np.uint8]:
        """Returns (side, 6 * side, 3) uint8 BGR. Raises InvalidValue if the images are unusable."""
        return self._get("rgb", scan, viewpoint, read_colours)

    def distances(self, scan: str, viewpoint: str) -> NDArray[np.uint16]:
        """Returns (side, 6 * side) uint16, 0.25 mm from the camera. Raises InvalidValue if the image is unusable."""
        return self._get("depth", scan, viewpoint, read_distances)

    def preload(self, scan: str, viewpoint: str, depth: bool) -> None:
        """Reads the images of a viewpoint and keeps them."""
        self._preloaded["rgb", scan, viewpoint] = self.colours(scan, viewpoint)
        if depth:
            self._preloaded["depth", scan, viewpoint] = self.distances(scan, viewpoint)

    def __len__(self) -> int:
        with self._lock:
            return sum(map(len, self._used.values()))

    def _get(self, kind: str, scan: str, viewpoint: str, read: Callable[[Path, str], NDArray[Any]]) -> NDArray[Any]:
        used, key = self._used[kind], (scan, viewpoint)
        with self._lock:
            found = used.get(key)
            if found is not None:
                used.move_to_end(key)
                return found
            found = self._preloaded.get((kind, scan, viewpoint))
        if found is None:
            found = read(self._folder / scan / FOLDER, viewpoint)
        with self._lock:
            used[key] = found
            while len(used) > self._size:
                used.popitem(last=False)
        return found


def read_colours(folder: Path, viewpoint: str) -> NDArray[np.uint8]:
    """Reads (side, 6 * side, 3) uint8 BGR from `<id>_skybox_small.jpg`, or from six `<id>_skybox<k>_sami.jpg`."""
    import cv2

    files = SkyboxFiles(folder)
    path = files.strip(viewpoint)
    if not os.path.lexists(path):
        faces = files.faces(viewpoint)
        if all(map(os.path.lexists, faces)):
            found = [_image(face, cv2.IMREAD_COLOR) for face in faces]
            if len({face.shape for face in found}) > 1:
                raise InvalidValue(f"The six faces {faces[0]} and so on have different sizes; {_THEN}.")
            return _strip(np.concatenate(found, axis=1), faces[0])
        raise InvalidValue(f"MatterSim: Could not open skybox RGB files at: {path}")
    return _shared(path, lambda: _strip(_image(path, cv2.IMREAD_COLOR), path))


def read_distances(folder: Path, viewpoint: str) -> NDArray[np.uint16]:
    """Reads (side, 6 * side) uint16 in 0.25 mm from `<id>_skybox_depth_small.png`."""
    import cv2

    path = SkyboxFiles(folder).depth(viewpoint)
    if not os.path.lexists(path):
        raise InvalidValue(f"MatterSim: Could not open skybox depth files at: {path}")

    def read() -> NDArray[np.uint16]:
        image = _image(path, cv2.IMREAD_UNCHANGED)
        if image.dtype != np.uint16 or image.ndim != 2:
            raise InvalidValue(f"{path} is not a depth image: it needs one channel of 16 bits; {_THEN}.")
        return _strip(image, path)

    return _shared(path, read)


def _shared(path: Path, read: Callable[[], NDArray[Any]]) -> NDArray[Any]:
    try:
        state = os.stat(path)
    except OSError as error:
        raise InvalidValue(f"Cannot read {path}: {error.strerror}; {_THEN}.") from error
    key = os.path.abspath(path), state.st_mtime_ns, state.st_size
    found = _SHARED.get(key)
    if found is None:
        found = _SHARED[key] = read()
    return found


def _image(path: Path, flags: int) -> NDArray[Any]:
    try:
        data = read_bytes(path)
        if is_cut_off(data):
            raise InvalidValue(f"{path} is truncated; {_THEN}.")
        return decoded(data, path, flags, what="a skybox", then=_THEN)
    except InvalidValue:
        raise
    except InputError as error:
        raise InvalidValue(str(error)) from error


def _strip(image: NDArray[Any], path: Path) -> NDArray[Any]:
    height, width = image.shape[:2]
    if width != 6 * height:
        raise InvalidValue(
            f"{path} is {width}x{height} pixels, but a skybox is six square faces side by side, {6 * height}x{height}; "
            f"{_THEN}."
        )
    return np.ascontiguousarray(image)
