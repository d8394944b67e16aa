"""The path of a camera through a building: key poses, and a smooth curve through them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import isfinite, pi, tan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.opening import read_json
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose

_LARGEST = 1 << 24  # bytes
_MOST_KEYS = 10_000
_FARTHEST = 1e7


@dataclass(frozen=True)
class KeyPose:
    """position   (x, y, z) meters, world
    heading    radians, 0 is +y, positive turns right
    elevation  radians, positive looks up
    fov        vertical field of view, radians
    """

    position: tuple[float, float, float]
    heading: float = 0.0
    elevation: float = 0.0
    fov: float = pi / 3

    def camera(self, width: int, height: int) -> Camera:
        """The pinhole camera of an image of `width` x `height` pixels."""
        focal = height / 2 / tan(self.fov / 2)
        intrinsics = Intrinsics(width, height, focal, focal, width / 2, height / 2)
        return Camera(intrinsics, camera_pose(np.asarray(self.position, np.float64), self.heading, self.elevation))


class CameraPath:
    """A cubic Hermite curve through the key poses, which are evenly spaced in time.

    Its tangents are half the difference of the neighboring keys (Catmull and Rom 1974), so it passes each key without a
    stop."""

    def __init__(self, keys: Sequence[KeyPose]) -> None:
        """Raises InputError for fewer than two keys."""
        if len(keys) < 2:
            raise InputError("A camera path needs two key poses or more; add another one.")
        self.keys = tuple(keys)
        rows = np.array([(*k.position, k.heading, k.elevation, k.fov) for k in keys], np.float64)
        rows[:, 3] = np.unwrap(rows[:, 3])  # turns the shorter way
        self._rows: NDArray[np.float64] = rows
        self._tangents = np.gradient(rows, axis=0)

    def at(self, share: float) -> KeyPose:
        """The pose at `share` (0 to 1) of the duration."""
        place = min(max(share, 0.0), 1.0) * (len(self.keys) - 1)
        first = min(int(place), len(self.keys) - 2)
        t = place - first
        p, q = self._rows[first : first + 2]
        m, n = self._tangents[first : first + 2]
        x = (2 * t**3 - 3 * t**2 + 1) * p + (t**3 - 2 * t**2 + t) * m + (3 * t**2 - 2 * t**3) * q + (t**3 - t**2) * n
        heading = float((x[3] + pi) % (2 * pi) - pi)
        elevation, fov = float(np.clip(x[4], -pi / 2, pi / 2)), float(np.clip(x[5], 0.05, 3.0))
        return KeyPose((float(x[0]), float(x[1]), float(x[2])), heading, elevation, fov)

    def frames(self, count: int) -> list[KeyPose]:
        """`count` poses, evenly spaced in time, from the first key to the last."""
        return [self.at(i / max(1, count - 1)) for i in range(count)]


def write_camera_path(path: Path, keys: Sequence[KeyPose]) -> None:
    """Write the keys as JSON."""
    from nvsim.files.atomic import write_text

    write_text(path, json.dumps({"camera_path": 1, "keys": [asdict(key) for key in keys]}, indent=1) + "\n")


def read_camera_path(path: Path) -> CameraPath:
    """The camera path in a JSON file. Raises InputError naming the file and the invalid key."""
    data = read_json(path, "a camera path", "save it again in the window", _LARGEST)
    rows = data.get("keys") if isinstance(data, dict) else None
    if not isinstance(rows, list):
        raise InputError(f"{path} has no list of keys; save the camera path again in the window.")
    if len(rows) > _MOST_KEYS:
        raise InputError(f"{path} has {len(rows)} keys; a camera path has at most {_MOST_KEYS}.")
    return CameraPath([_key(path, number, row) for number, row in enumerate(rows, 1)])


def _key(path: Path, number: int, row: object) -> KeyPose:
    try:
        if not isinstance(row, dict) or not isinstance(row["position"], list):
            raise TypeError
        x, y, z = map(_number, row["position"])
        rest = [_number(row[name]) for name in ("heading", "elevation", "fov")]
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{path}: key {number} lacks a position of three numbers, a heading, an elevation or a fov."
        ) from error
    if not all(map(isfinite, (x, y, z, *rest))) or not 0 < rest[2] < pi:
        raise InputError(f"{path}: key {number} has a value that is not finite, or a fov not between 0 and pi.")
    if max(map(abs, (x, y, z, *rest))) > _FARTHEST:
        raise InputError(f"{path}: key {number} is farther than {_FARTHEST:.0e} from the origin; write meters.")
    return KeyPose((x, y, z), *rest)


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError
    return float(value)
