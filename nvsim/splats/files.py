"""Save and load a submap model as a folder: gaussians-*.ply, networks-*.safetensors (background, floor texture, floor
surface, appearance), and model.json. If the user removed Gaussians, removed-*.npz has their rows in the PLY file.

model.json names the format, and the name, size, and SHA-256 of the other files. The arrays of a loaded model fit
together, so that rendering it cannot fail.

The names of the data files contain a hash of their content. The files of a new model can therefore be written next
to the old ones, until model.json is replaced in one step.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy
from numpy.typing import NDArray

from nvsim.errors import InputError, value_text
from nvsim.files import atomic
from nvsim.files.opening import opened, read_json, refuse_placeholder
from nvsim.files.stored_arrays import read_arrays, write_arrays
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.appearance import describe, read_appearance, tensors_of
from nvsim.splats.ply import read_gaussians, write_ply
from nvsim.splats.types import Background, FloorTexture, SubmapModel, select_gaussians

_MOST_OCTAVES = 64


def check_model(model: SubmapModel) -> None:
    """Raises ValueError, or the error that numpy raises if shapes do not fit together."""
    floor = model.floor
    if floor.heights.ndim != 2 or floor.heights.size == 0 or not floor.spacing > 0:
        raise ValueError(f"a floor of shape {floor.heights.shape}")
    _check_finite("floor", floor.heights, *floor.origin, floor.spacing)
    if model.texture is not None:
        for level in model.texture.levels:
            if level.ndim != 3 or level.shape[2] != 3 or level.size == 0:
                raise ValueError(f"a floor texture of shape {level.shape}")
        _check_finite("floor texture", *model.texture.levels, *model.texture.low, *model.texture.high)
    middle = np.zeros(3)
    if model.background is not None:
        _check_embedding(model.background.octaves, model.background.period)
        _check_finite("background", *model.background.weights.values())
        if _has_embedding(model.background.weights):
            model.background.coefficients(middle)
    if model.appearance is not None:
        embedding = model.appearance.embedding
        _check_embedding(embedding.octaves, embedding.period)
        _check_finite("appearance", *embedding.weights.values(), *model.appearance.weights.values())
        _check_finite("appearance", model.appearance.features, model.appearance.middle)
        if len(model.gaussians) and _has_embedding(embedding.weights):
            one = select_gaussians(model.gaussians, np.array([0]))
            model.appearance.of_rows(np.array([0])).colored(one, model.appearance.middle)


def _has_embedding(weights: dict[str, np.ndarray]) -> bool:
    return "embed.0.weight" in weights or "index.vectors" in weights


def _check_embedding(octaves: int, period: float) -> None:
    if not 0 <= octaves <= _MOST_OCTAVES or not 0 < period < math.inf:
        raise ValueError(f"an embedding of {octaves} octaves and period {period}")


def _check_finite(what: str, *arrays: object) -> None:
    if not all(np.isfinite(array).all() for array in arrays):  # type: ignore[call-overload]
        raise ValueError(f"a {what} with values that are not finite")


FORMAT, VERSION = "nvsim submap model", 2
DESCRIPTION = "model.json"
_OLD_VERSION = 1  # file names without a hash
_GAUSSIANS, _NETWORKS, _REMOVED = ("gaussians", ".ply"), ("networks", ".safetensors"), ("removed", ".npz")
_ATTEMPTS = 3
_LONGEST = 1 << 24  # bytes of model.json


def save_model(model: SubmapModel, folder: Path) -> None:
    """Writes the model to `folder` and replaces the model there. A process killed at any moment leaves either the old
    model or the new one, complete. Only one process may write a folder at a time. Raises InputError if the disk
    refuses."""
    atomic.make_folder(folder)
    staged = folder / f".{_GAUSSIANS[0]}{_GAUSSIANS[1]}"
    try:
        before = {path.name for path in folder.iterdir()}
        write_ply(staged, model.gaussians, model.antialiased)
        files = dict([_rename_by_content(staged, _GAUSSIANS)])
        staged = folder / f".{_NETWORKS[0]}{_NETWORKS[1]}"
        atomic.write_bytes(staged, safetensors.numpy.save(_tensors(model)))
        files |= dict([_rename_by_content(staged, _NETWORKS)])
        text = json.dumps({**_description(model), "files": files}, indent=1)
        atomic.write_text(folder / DESCRIPTION, text + "\n")
    except OSError as error:
        raise atomic.as_input_error(folder, error) from error
    finally:
        staged.unlink(missing_ok=True)
    starts = (_GAUSSIANS[0], _NETWORKS[0], _REMOVED[0], f"{Path(DESCRIPTION).stem}-")
    _delete_old_files(folder, before - {DESCRIPTION, *files}, starts)


def _delete_old_files(folder: Path, names: Iterable[str], starts: tuple[str, ...]) -> None:
    """Deletes the files of `names` that begin with one of `starts`: those of an old model or of a killed process. A
    file that is in use and cannot be deleted is left to the next call."""
    for name in names:
        if name.lstrip(".").startswith(starts):
            with contextlib.suppress(OSError):
                atomic.remove(folder / name)


def store_removed(folder: Path, removed: NDArray[np.bool_]) -> None:
    """Stores which Gaussians of the model in `folder` are removed, and replaces what was stored before. `removed` (N,)
    bool has a value for each Gaussian of the PLY file, which is not changed. A process killed at any moment leaves the
    old state or the new one.

    Raises ValueError if the model has another number of Gaussians, InputError if it is damaged or the disk refuses."""
    data = _read_description(folder)
    with _description_errors(folder):
        files = {name: about for name, about in data["files"].items() if not name.startswith(_REMOVED[0])}
        count = int(data["count"])
    if removed.shape != (count,):
        raise ValueError(f"{removed.shape} values for {count} Gaussians")
    rows, staged = np.flatnonzero(removed).astype(np.int32), folder / f".{_REMOVED[0]}{_REMOVED[1]}"
    try:
        before = {path.name for path in folder.iterdir()}
        if len(rows):
            write_arrays(staged, {"rows": rows})
            files |= dict([_rename_by_content(staged, _REMOVED)])
        text = json.dumps({**data, "files": files, "removed": len(rows)}, indent=1)
        atomic.write_text(folder / DESCRIPTION, text + "\n")
    except OSError as error:
        raise atomic.as_input_error(folder, error) from error
    finally:
        staged.unlink(missing_ok=True)
    _delete_old_files(folder, before - set(files), (_REMOVED[0],))


def load_removed(folder: Path) -> NDArray[np.bool_]:
    """(N,) bool, which Gaussians of the PLY file in `folder` are removed. Raises InputError like `load_model`."""
    data = _read_description(folder)
    with _description_errors(folder):
        return _read_removed(folder, data)


def removal_digest(folder: Path) -> str:
    """A hash of the removed Gaussians of the model in `folder`; "" if none are removed. Raises InputError if its
    description is missing or damaged."""
    data = _read_description(folder)
    with _description_errors(folder):
        name = _removed_name(data)
        return "" if name is None else str(data["files"][name]["sha256"])


def _removed_name(data: dict[str, Any]) -> str | None:
    """The name of the file of removed Gaussians, None if there is none. Raises ValueError if there are several."""
    names = [n for n in data["files"] if n.startswith(_REMOVED[0]) and n.endswith(_REMOVED[1]) and Path(n).name == n]
    if len(names) > 1:
        raise ValueError(f"{len(names)} files of {_REMOVED[0]}")
    return names[0] if names else None


def _read_removed(folder: Path, data: dict[str, Any]) -> NDArray[np.bool_]:
    removed = np.zeros(int(data["count"]), bool)
    name = _removed_name(data)
    if name is None:
        return removed
    path, then = folder / name, "train this submap again, or import its splat file again"
    _check_sizes((path,), data["files"])
    _check(path, _fingerprint(path)["sha256"], data["files"])
    rows = read_arrays(path, "a list of removed Gaussians", {"rows": ("i", 1)}, then)["rows"]
    if len(rows) and not (rows.min() >= 0 and rows.max() < len(removed)):
        raise ValueError(f"a removed Gaussian {rows.max()} of {len(removed)}")
    removed[rows] = True
    return removed


def _rename_by_content(staged: Path, kind: tuple[str, str]) -> tuple[str, dict[str, Any]]:
    """Renames a file after its content; returns that name and the fingerprint."""
    fingerprint = _fingerprint(staged)
    name = f"{kind[0]}-{fingerprint['sha256'][:16]}{kind[1]}"
    os.replace(staged, staged.with_name(name))
    return name, fingerprint


_verified: dict[Path, dict[str, tuple[int, int, int]]] = {}
# Folders whose hashes this process has verified, with the status of the files at that time. If the files are unchanged,
# a model that was evicted and is loaded again is not hashed again.


def load_model(folder: Path, with_removed: bool = False) -> SubmapModel:
    """Loads a model written by `save_model`, without its removed Gaussians, or `with_removed` ones. Raises InputError
    naming the file that is missing, damaged, or of a newer version."""
    for attempt in range(_ATTEMPTS):
        data = _read_description(folder)
        try:
            return _load(folder, data, with_removed)
        except InputError:
            # Another process may have replaced the model and removed its files after the description was read.
            if attempt + 1 == _ATTEMPTS or _read_description(folder) == data:
                raise
    raise AssertionError("the last attempt returns or raises")


@contextlib.contextmanager
def _description_errors(folder: Path) -> Iterator[None]:
    """Turns errors in its body into an InputError: the description is damaged, or the system cannot read the files."""
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"Cannot read {folder}: {error}; train this submap again.") from error
    except Exception as error:  # numpy and safetensors raise many types if shapes and types do not match
        raise InputError(
            f"{folder / DESCRIPTION} is damaged or does not fit its files ({error!r:.200}); train this submap again."
        ) from error


def _load(folder: Path, data: dict[str, Any], with_removed: bool) -> SubmapModel:
    with _description_errors(folder):
        model = _read_model(folder, data)
        if with_removed or _removed_name(data) is None:
            return model
        return model.selected(~_read_removed(folder, data))


def _read_model(folder: Path, data: dict[str, Any]) -> SubmapModel:
    paths = gaussians_path, networks_path = _paths(folder, data)
    _check_sizes(paths, data["files"])
    stamps = {path.name: _stamp(path) for path in paths}
    unchanged = _verified.get(folder) == stamps
    gaussians, digest = read_gaussians(gaussians_path, hashed=not unchanged)
    if not unchanged:
        _check(gaussians_path, digest, data["files"])
        _check(networks_path, _fingerprint(networks_path)["sha256"], data["files"])
        _verified[folder] = stamps
    # Read one tensor after the other, so that the whole file is never in memory.
    with safetensors.safe_open(networks_path, framework="numpy") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is not a dict
    model = SubmapModel(
        gaussians,
        _background(data["background"], tensors),
        _texture(data["texture"], tensors),
        FloorSurface(
            _writable_copy(tensors["floor.heights"]), _pair(data["floor"]["origin"]), float(data["floor"]["spacing"])
        ),
        bool(data["antialiased"]),
        dict(data["info"]),
        read_appearance(data.get("appearance"), tensors, len(gaussians)),
    )
    check_model(model)
    return model


def _paths(folder: Path, data: dict[str, Any]) -> tuple[Path, Path]:
    """The paths of the Gaussians and the networks. Raises ValueError unless the description names one file of each."""
    found = []
    for start, suffix in (_GAUSSIANS, _NETWORKS):
        names = [n for n in data["files"] if n.startswith(start) and n.endswith(suffix) and Path(n).name == n]
        if len(names) != 1:
            raise ValueError(f"{len(names)} files of {start}")
        found.append(folder / names[0])
    return found[0], found[1]


def memory_needed(folder: Path) -> int:
    """Bytes that the arrays of the model in `folder` will need, computed before they are read. At least as many as
    scene.memory_of returns after loading. Raises InputError if the description is missing or damaged."""
    data = _read_description(folder)
    with _description_errors(folder):
        colors = 3 * (int(data["sh_degree"]) + 1) ** 2
        values = 11 + colors * (1 if data.get("appearance") is None else 2)
        path = _paths(folder, data)[1]
        head = 0  # the file is missing if the model was just replaced; loading finds the new one
        if path.exists():
            with opened(path) as file:
                head = 8 + int.from_bytes(file.read(8), "little")
        networks = max(0, int(data["files"][path.name]["bytes"]) - head)
        return 4 * values * int(data["count"]) + networks * (1 if data["texture"] is None else 2)


def gaussian_count(folder: Path) -> int:
    """The number of Gaussians of the model in `folder` that are not removed. Raises InputError if its description is
    missing or damaged."""
    data = _read_description(folder)
    with _description_errors(folder):
        return int(data["count"]) - int(data.get("removed", 0))


def _read_description(folder: Path) -> dict[str, Any]:
    path = folder / DESCRIPTION
    then = "it is damaged: train this submap again"
    data = read_json(path, "the description of a submap model", then, _LONGEST, strict=False)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise InputError(f"{path} does not describe a submap model; choose a folder that `nvsim train` wrote.")
    if data.get("version") not in (_OLD_VERSION, VERSION):
        raise InputError(
            f"{path} has version {value_text(data.get('version'))}, but this program reads version {VERSION}; update "
            "the program."
        )
    return data


def _check_sizes(paths: tuple[Path, ...], files: dict[str, Any]) -> None:
    # Sizes are checked before anything is read, so that a truncated file is reported at once.
    for path in paths:
        if path.stat().st_size != files[path.name]["bytes"]:
            refuse_placeholder(path)
            raise InputError(f"{path} is damaged: its size does not match model.json; train this submap again.")


def _check(path: Path, digest: str | None, files: dict[str, Any]) -> None:
    if digest != files[path.name]["sha256"]:
        raise InputError(f"{path} is damaged: its content does not match model.json; train this submap again.")


def _stamp(path: Path) -> tuple[int, int, int]:
    status = path.stat()
    return status.st_size, status.st_mtime_ns, status.st_ino


def _description(model: SubmapModel) -> dict[str, Any]:
    background, texture = model.background, model.texture
    return {
        "format": FORMAT,
        "version": VERSION,
        "antialiased": model.antialiased,
        "count": len(model.gaussians),
        "sh_degree": model.gaussians.sh_degree,
        "background": None
        if background is None
        else {"octaves": background.octaves, "period": background.period, "nearest": background.nearest},
        "texture": None
        if texture is None
        else {
            "levels": len(texture.levels),
            "low": list(map(float, texture.low)),
            "high": list(map(float, texture.high)),
        },
        "floor": {"origin": list(map(float, model.floor.origin)), "spacing": float(model.floor.spacing)},
        "info": model.info,
        "appearance": describe(model.appearance),
    }


def _tensors(model: SubmapModel) -> dict[str, np.ndarray]:
    tensors = {"floor.heights": model.floor.heights}
    if model.background is not None:
        tensors |= {f"background.{name}": w for name, w in model.background.weights.items()}
    if model.texture is not None:
        tensors |= {f"texture.{i}": level for i, level in enumerate(model.texture.levels)}
    tensors |= tensors_of(model.appearance)
    return {name: np.ascontiguousarray(array, np.float32) for name, array in tensors.items()}


def _background(data: dict[str, Any] | None, tensors: dict[str, np.ndarray]) -> Background | None:
    if data is None:
        return None
    prefix = "background."
    weights = {name.removeprefix(prefix): _writable_copy(w) for name, w in tensors.items() if name.startswith(prefix)}
    return Background(weights, int(data["octaves"]), float(data["period"]), bool(data.get("nearest", False)))


def _texture(data: dict[str, Any] | None, tensors: dict[str, np.ndarray]) -> FloorTexture | None:
    if data is None:
        return None
    levels = tuple(_writable_copy(tensors[f"texture.{i}"]) for i in range(int(data["levels"])))
    return FloorTexture(levels, _pair(data["low"]), _pair(data["high"]))


def _writable_copy(array: np.ndarray) -> np.ndarray:
    # Copies, because arrays from safetensors may be read-only.
    return np.array(array, np.float32, order="C")


def _pair(values: Any) -> tuple[float, float]:  # Any: JSON of the description
    first, second = values
    return float(first), float(second)


def _fingerprint(path: Path) -> dict[str, Any]:
    with opened(path) as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"bytes": path.stat().st_size, "sha256": digest}
