"""An interrupted training on disk: every array that a step changes, and what it belongs to. One file, whole or none."""

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
from nvsim.files.atomic import replacing
from nvsim.files.reading import reading
from nvsim.files.regular import opened
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.training.config import TrainingConfig
from nvsim.training.views import TrainingView

FORMAT = 2
_ABOUT = "about"
Arrays = dict[str, NDArray[np.generic]]


class Stateful(Protocol):
    """A part of a training that changes from step to step."""

    def state(self) -> Arrays:
        """Everything that a step may change and a later step depends on, by name. Numbers are arrays of no dimension.
        The arrays may be live ones: they are written at once."""

    def restore(self, arrays: Arrays) -> None:
        """The inverse, in a part made from the same inputs."""


def gather(parts: Mapping[str, Stateful]) -> Arrays:
    """The arrays of all parts, named PART/NAME."""
    return {f"{part}/{name}": array for part, one in parts.items() for name, array in one.state().items()}


def spread(parts: Mapping[str, Stateful], arrays: Arrays) -> None:
    """Gives every part its own of what `gather` collected."""
    for part, one in parts.items():
        prefix = f"{part}/"
        one.restore({name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)})


def check_shapes(now: Arrays, stored: Arrays, of_gaussians: set[str]) -> None:
    """Raises ValueError when the `stored` arrays cannot take the place of those of a training `now`: those
    `of_gaussians` may have another number of rows than now, all of them the same."""
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
    """step    updates done so far
    arrays     as `gather` names them
    progress   JSON-able: random state, order of the views, running figures, number of threads
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
    """A hash of all that a training is made from: data, configuration and seed. How often it is saved is not part of
    it, nor the number of threads and the device, which change no more than the rounding of sums."""
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
    """Raises InputError when the disk refuses."""
    about = {"key": key, "step": checkpoint.step, "progress": checkpoint.progress}
    text = np.frombuffer(json.dumps(about).encode(), np.uint8)
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, **{_ABOUT: text}, **checkpoint.arrays)  # type: ignore[arg-type]


def load(path: Path, key: str) -> Checkpoint | None:
    """The checkpoint at `path`; None when it belongs to other data, another configuration or another program version.

    Raises InputError when the file is there but cannot be read or is not a checkpoint.
    """
    then = "delete it to train from the start"
    with opened(path) as file, reading(path, "a checkpoint", then), zipfile.ZipFile(file) as archive:
        if any(entry.compress_type != zipfile.ZIP_STORED for entry in archive.infolist()):
            raise InputError(f"{path} is not a checkpoint as it is written, but a packed one; {then}.")
        file.seek(0)
        with np.load(file, allow_pickle=False) as stored:
            about = json.loads(_array(archive, stored, _ABOUT).tobytes())
            if about["key"] != key:
                return None
            arrays = {name: _array(archive, stored, name) for name in stored.files if name != _ABOUT}
        step = about["step"]
        if type(step) is not int or step < 0 or not isinstance(about["progress"], dict):
            raise ValueError("no step and no progress in it")
        return Checkpoint(step, arrays, about["progress"])


def _array(archive: zipfile.ZipFile, stored: Mapping[str, NDArray[Any]], name: str) -> NDArray[Any]:
    """One of the arrays. Raises ValueError when it announces more than its part of the file holds."""
    entry = archive.getinfo(f"{name}.npy")
    with archive.open(entry) as head:
        version = np.lib.format.read_magic(head)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(head, max_header_size=10_000)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize > entry.file_size:
        raise ValueError(f"array {name} of shape {shape} does not fit in {entry.file_size} bytes")
    return stored[name]
