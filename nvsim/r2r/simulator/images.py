"""The sources of a simulator's images: the skybox strips of a dataset, or the models of a project."""

from __future__ import annotations

import math
import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.images import decode_pixels, is_cut_off
from nvsim.files.opening import read_bytes
from nvsim.geometry.camera import camera_pose
from nvsim.graph.skybox_files import FOLDER, SkyboxFiles
from nvsim.r2r.simulator.conventions import InvalidValue
from nvsim.r2r.simulator.scan import Scan, Scans

if TYPE_CHECKING:
    Drawn = tuple[NDArray[np.uint8], NDArray[np.uint16] | None]
    """(height, width, 3) BGR, and (height, width, 1) depth along the optical axis in 0.25 mm."""

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
    view = np.linalg.inv(rotation) @ camera_pose(np.zeros(3), heading, elevation)[:3, :3]
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

    def colors(self, scan: str, viewpoint: str) -> NDArray[np.uint8]:
        """Returns (side, 6 * side, 3) uint8 BGR. Raises InvalidValue if the images are unusable."""
        return self._get("rgb", scan, viewpoint, read_colors)

    def distances(self, scan: str, viewpoint: str) -> NDArray[np.uint16]:
        """Returns (side, 6 * side) uint16, 0.25 mm from the camera. Raises InvalidValue if the image is unusable."""
        return self._get("depth", scan, viewpoint, read_distances)

    def preload(self, scan: str, viewpoint: str, depth: bool) -> None:
        """Reads the images of a viewpoint and keeps them."""
        self._preloaded["rgb", scan, viewpoint] = self.colors(scan, viewpoint)
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


def read_colors(folder: Path, viewpoint: str) -> NDArray[np.uint8]:
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
    return _read_cached(path, lambda: _strip(_image(path, cv2.IMREAD_COLOR), path))


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

    return _read_cached(path, read)


def _read_cached(path: Path, read: Callable[[], NDArray[Any]]) -> NDArray[Any]:
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
        return decode_pixels(data, path, flags, what="a skybox", then=_THEN)
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


try:
    from nvsim.r2r.simulator.compiled_drawing import draw_colors, draw_depth
except ModuleNotFoundError:  # the package nvsim-mattersim has no numba
    from nvsim.r2r.simulator.plain_drawing import draw_colors, draw_depth  # type: ignore[assignment]


@dataclass(frozen=True)
class ViewSize:
    """The size of a view: width and height in pixels, vertical field of view in radians, and whether it has depth."""

    width: int
    height: int
    vfov: float
    depth: bool


@dataclass(frozen=True)
class Goal:
    """The target of a move: x, y, z in meters, world. If z is None, the height above the floor is unchanged.

    straight   whether the straight way to it must be free, or only the position itself
    """

    x: float
    y: float
    z: float | None
    straight: bool


_ALONE = "A skybox dataset has images only at its viewpoints; give setDatasetPath a project to move elsewhere."


class Images(Protocol):
    """Draws the views of a simulator. Several threads may call it.

    one_thread_each   whether a view uses one thread, so that several views are drawn in parallel
    """

    one_thread_each: bool

    def draw(self, scan: Scan, index: int, heading: float, elevation: float, view: ViewSize) -> Drawn:
        """Returns the view from a viewpoint; angles in radians. Raises InvalidValue if its images are unusable."""

    def draw_from(self, position: NDArray[np.float64], heading: float, elevation: float, view: ViewSize) -> Drawn:
        """Returns the view from a position (3,), meters. Raises InvalidValue if there are only viewpoint images."""

    def preload(self, scans: Scans, depth: bool) -> None:
        """Loads all images or models."""

    def position_after_move(self, here: NDArray[np.float64], goal: Goal) -> NDArray[np.float64]:
        """Returns the camera position (3,), meters, after a move from `here` (3,) to `goal`.

        Raises InvalidValue with the reason if the move is not possible.
        """

    def reachable(self, place: NDArray[np.float64], scan: Scan) -> list[int]:
        """Returns the indices of the viewpoints near a position (3,), meters, to which the way is free."""

    def close(self) -> None:
        """Releases all images or models."""


class StripImages:
    """Views from the skybox strips in the folder of a dataset."""

    one_thread_each = True

    def __init__(self, folder: Path | str, cache_size: int) -> None:
        self.cache = StripCache(folder, cache_size)

    def draw(self, scan: Scan, index: int, heading: float, elevation: float, view: ViewSize) -> Drawn:
        id = scan.ids[index]
        strip = self.cache.colors(scan.id, id)
        rays, plane = rays_of(scan.rotation[index], heading, elevation, view.width, view.height, view.vfov)
        rgb = np.empty((view.height, view.width, 3), np.uint8)
        draw_colors(strip, rays, rgb)
        if not view.depth:
            return rgb, None
        depth = np.empty((view.height, view.width, 1), np.uint16)
        draw_depth(self.cache.distances(scan.id, id), rays, plane, depth)
        return rgb, depth

    def draw_from(self, position: NDArray[np.float64], heading: float, elevation: float, view: ViewSize) -> Drawn:
        """Raises InvalidValue for every position (3,), because there are only images of viewpoints."""
        raise InvalidValue(_ALONE)

    def preload(self, scans: Scans, depth: bool) -> None:
        for id in scans.scan_ids():
            scan = scans.scan(id)
            for viewpoint, included in zip(scan.ids, scan.included.tolist()):
                if included:
                    self.cache.preload(id, viewpoint, depth)

    def position_after_move(self, here: NDArray[np.float64], goal: Goal) -> NDArray[np.float64]:
        """Raises InvalidValue for every position `here` (3,), because there are only images of viewpoints."""
        raise InvalidValue(_ALONE)

    def reachable(self, place: NDArray[np.float64], scan: Scan) -> list[int]:
        """Returns an empty list for every position (3,), because free space is unknown."""
        return []

    def close(self) -> None:
        pass


def draw_all(images: Images, wanted: Sequence[Callable[[], Drawn]]) -> list[Drawn]:
    """Draws views in sequence, or in parallel threads if `one_thread_each` is true."""
    if len(wanted) == 1 or not images.one_thread_each:
        return [draw() for draw in wanted]
    return list(_threads().map(lambda draw: draw(), wanted))


@lru_cache(maxsize=None)  # noqa: UP033 (Python 3.8)
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(
        os.process_cpu_count() if hasattr(os, "process_cpu_count") else os.cpu_count(), "nvsim-view"
    )
