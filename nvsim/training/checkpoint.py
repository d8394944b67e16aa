"""Checkpoints of interrupted trainings: every array that a step changes, and a fingerprint of the inputs. One file,
written completely or not at all. A `RateLimiter` decides how often a training writes files."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.errors import InputError
from nvsim.files.opening import opened
from nvsim.files.reading import reading
from nvsim.files.stored_arrays import array_in, write_arrays
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.training.config import TrainingConfig
from nvsim.training.views import TrainingView

FORMAT = 2
_ABOUT = "about"
Arrays = dict[str, NDArray[np.generic]]


class Stateful(Protocol):
    """A part of a training that changes from step to step."""

    def state(self) -> Arrays:
        """All arrays that a step can change and a later step depends on, by name. Numbers are arrays of shape (). The
        arrays can be live ones, because they are written immediately."""

    def restore(self, arrays: Arrays) -> None:
        """Restores the `arrays` of `state` in a part made from identical inputs."""


def arrays_of_parts(parts: Mapping[str, Stateful]) -> Arrays:
    """The arrays of all parts, named PART/NAME, of any shape."""
    return {f"{part}/{name}": array for part, one in parts.items() for name, array in one.state().items()}


def restore_parts(parts: Mapping[str, Stateful], arrays: Arrays) -> None:
    """Restores every part from the arrays of `arrays_of_parts`."""
    for part, one in parts.items():
        prefix = f"{part}/"
        one.restore({name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)})


def check_shapes(now: Arrays, stored: Arrays, of_gaussians: set[str]) -> None:
    """Raises ValueError if the `stored` arrays cannot replace those of a training `now`. Arrays named in `of_gaussians`
    can have another number of rows than now, but an equal one for all. The other arrays must have equal shapes."""
    rows = {stored[name].shape[:1] for name in of_gaussians & stored.keys()}
    if len(rows) != 1:
        raise ValueError("its arrays have different numbers of Gaussians")
    for name, array in now.items():
        other = stored.get(name)
        if other is None:
            raise ValueError(f"it has no {name}")
        shape = (*next(iter(rows)), *array.shape[1:]) if name in of_gaussians else array.shape
        if other.dtype != array.dtype or other.shape != shape:
            raise ValueError(f"{name} is {other.dtype} of shape {other.shape}, not of {shape}")
        if other.dtype.kind == "f" and not np.isfinite(other).all():
            raise ValueError(f"{name} holds values that are not finite")


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """step    number of completed updates
    arrays     named as in `arrays_of_parts`
    progress   JSON-compatible: random state, order of the views, running figures, number of threads
    """

    step: int
    arrays: Arrays
    progress: dict[str, Any]


def fingerprint(
    views: Sequence[TrainingView],
    cloud: Cloud | None,
    floor: FloorSurface,
    config: TrainingConfig,
    seed: int,
) -> str:
    """A hash of all inputs of a training: data, configuration, and seed. The checkpoint interval, the number of
    threads, and the device are left out. The last two change only the rounding of sums."""
    digest = hashlib.blake2b(digest_size=16)
    settings = dataclasses.asdict(dataclasses.replace(config, threads=0, checkpoint_seconds=0.0))
    del settings["device"]
    digest.update(json.dumps([FORMAT, settings, seed, floor.origin, floor.spacing], sort_keys=True).encode())
    arrays: list[NDArray[Any]] = [floor.heights]
    if cloud is not None:
        arrays += [cloud.points] if cloud.colors is None else [cloud.points, cloud.colors]
    for view in views:
        digest.update(f"{view.name}\0{view.camera.intrinsics}".encode())
        arrays += [view.camera.camera_to_world, view.image, view.floor]
        arrays += [mask for mask in (view.doubtful, view.usable) if mask is not None]
    for array in arrays:
        digest.update(str(array.shape).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def save(path: Path, checkpoint: Checkpoint, key: str) -> None:
    """Writes a checkpoint. Raises InputError if the file cannot be written."""
    about = {"key": key, "step": checkpoint.step, "progress": checkpoint.progress}
    text = np.frombuffer(json.dumps(about).encode(), np.uint8)
    write_arrays(path, {_ABOUT: text, **checkpoint.arrays}, compressed=False)


def load(path: Path, key: str) -> Checkpoint | None:
    """The checkpoint at `path`; None if it belongs to other data, another configuration, or another program version.

    Raises InputError if the file cannot be read or is not a checkpoint.
    """
    then = "delete it to train from the start"
    with opened(path) as file, reading(path, "a checkpoint", then), zipfile.ZipFile(file) as archive:
        if any(entry.compress_type != zipfile.ZIP_STORED for entry in archive.infolist()):
            raise InputError(f"{path} is a compressed archive, which is not a checkpoint of NVSim; {then}.")
        about = json.loads(array_in(archive, f"{_ABOUT}.npy").tobytes())
        if about["key"] != key:
            return None
        names = [entry.removesuffix(".npy") for entry in archive.namelist()]
        arrays = {name: array_in(archive, f"{name}.npy") for name in names if name != _ABOUT}
        step = about["step"]
        if type(step) is not int or step < 0 or not isinstance(about["progress"], dict):
            raise ValueError("it has no valid step or progress")
        return Checkpoint(step, arrays, about["progress"])


class RateLimiter:
    """The pace of a repeated task: never within `least` seconds of the last time, at most `share` of the time, but at
    the latest after `most` seconds. Times are seconds of one clock."""

    def __init__(self, now: float, least: float, share: float = 1.0, most: float = math.inf) -> None:
        self._least, self._share, self._most = least, share, most
        self._last, self._pause = now, min(least, most)

    def is_due(self, now: float) -> bool:
        """Whether the task is due at the time `now`, seconds."""
        return now - self._last >= self._pause

    def record_run(self, began: float, ended: float) -> None:
        """Records that the task ran from `began` to `ended`, seconds."""
        self._last = ended
        self._pause = min(self._most, max(self._least, (ended - began) / self._share))
