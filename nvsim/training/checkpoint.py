"""An interrupted training on disk: every array that a step changes, and what it belongs to. One file, whole or none."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.atomic import replacing
from nvsim.capture.types import Cloud
from nvsim.errors import InputError
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
    it, nor the number of threads, which changes no more than the order of sums."""
    digest = hashlib.blake2b(digest_size=16)
    settings = dataclasses.asdict(dataclasses.replace(config, threads=0, checkpoint_seconds=0.0))
    digest.update(json.dumps([FORMAT, settings, seed, floor.origin, floor.spacing], sort_keys=True).encode())
    arrays: list[NDArray[Any]] = [floor.heights]
    if cloud is not None:
        arrays += [cloud.points] if cloud.colors is None else [cloud.points, cloud.colors]
    for view in views:
        digest.update(f"{view.name}\0{view.camera.intrinsics}".encode())
        arrays += [view.camera.camera_to_world, view.image, view.floor]
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
    try:
        with np.load(path, allow_pickle=False) as file:
            about = json.loads(file[_ABOUT].tobytes())
            if about["key"] != key:
                return None
            arrays = {name: file[name] for name in file.files if name != _ABOUT}
        return Checkpoint(int(about["step"]), arrays, about["progress"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path} is not a readable checkpoint ({error}); delete it to train from the start."
        ) from error
