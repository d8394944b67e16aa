"""A submap model as a folder: gaussians.ply, networks.safetensors (background, floor texture, floor surface), and
model.json, which names the format and the size and SHA-256 of the others.

The folder appears whole: it is written beside its place and then moved there.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy

from nvsim import atomic
from nvsim.errors import InputError
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats.blocks import read_gaussians
from nvsim.splats.ply import write_ply
from nvsim.splats.types import Background, FloorTexture, SubmapModel

FORMAT, VERSION = "nvsim submap model", 1
GAUSSIANS, NETWORKS, DESCRIPTION = "gaussians.ply", "networks.safetensors", "model.json"


def save_model(model: SubmapModel, folder: Path) -> None:
    """Writes `folder`; one that exists is replaced. A process killed on the way leaves either the old model or the new
    or, between the two renames, none; never a half. Raises InputError when the disk refuses."""
    with _replacing_folder(folder) as place:
        write_ply(place / GAUSSIANS, model.gaussians, model.antialiased)
        atomic.write_bytes(place / NETWORKS, safetensors.numpy.save(_tensors(model)))
        files = {name: _fingerprint(place / name) for name in (GAUSSIANS, NETWORKS)}
        text = json.dumps({**_description(model), "files": files}, indent=1)
        atomic.write_text(place / DESCRIPTION, text + "\n")


_verified: dict[Path, dict[str, tuple[int, int, int]]] = {}
# Folders whose fingerprints this process has checked, and the files' status then: a model that was evicted and comes
# back is not hashed again while its files are the same.


def load_model(folder: Path) -> SubmapModel:
    """What `save_model` wrote. Raises InputError naming the file that is missing, damaged, or of a newer version."""
    data, path = _read_description(folder), folder / DESCRIPTION
    try:
        _check_sizes(folder, data["files"])
        stamps = {name: _stamp(folder / name) for name in (GAUSSIANS, NETWORKS)}
        unchanged = _verified.get(folder) == stamps
        gaussians, digest = read_gaussians(folder / GAUSSIANS, hashed=not unchanged)
        if not unchanged:
            _check(folder / GAUSSIANS, digest, data["files"])
            _check(folder / NETWORKS, _fingerprint(folder / NETWORKS)["sha256"], data["files"])
            _verified[folder] = stamps
        # One tensor after the other: the file as a whole is never in memory.
        with safetensors.safe_open(folder / NETWORKS, framework="numpy") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no dict
        return SubmapModel(
            gaussians,
            _background(data["background"], tensors),
            _texture(data["texture"], tensors),
            FloorSurface(_owned(tensors["floor.heights"]), _pair(data["floor"]["origin"]), data["floor"]["spacing"]),
            bool(data["antialiased"]),
            dict(data["info"]),
        )
    except OSError as error:
        raise InputError(f"Cannot read {folder}: {error}; train this submap again.") from error
    except (KeyError, TypeError, ValueError, safetensors.SafetensorError) as error:
        raise InputError(f"{path} is damaged ({error!r}); train this submap again.") from error


def memory_needed(folder: Path) -> int:
    """Bytes that the arrays of the model in `folder` will take, before they are read; at least what scene.memory_of
    says of them later. Raises InputError when its description is missing or damaged."""
    data = _read_description(folder)
    try:
        colours = 3 * (int(data["sh_degree"]) + 1) ** 2
        values = 11 + colours * (1 if data.get("appearance") is None else 2)
        with open(folder / NETWORKS, "rb") as file:
            head = 8 + int.from_bytes(file.read(8), "little")
        networks = max(0, int(data["files"][NETWORKS]["bytes"]) - head)
        return 4 * values * int(data["count"]) + networks * (1 if data["texture"] is None else 2)
    except OSError as error:
        raise InputError(f"Cannot read {folder}: {error}; train this submap again.") from error
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder / DESCRIPTION} is damaged ({error!r}); train this submap again.") from error


def _read_description(folder: Path) -> dict[str, Any]:
    path = folder / DESCRIPTION
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"Cannot read {path}: {error.strerror or error}; train this submap again.") from error
    except ValueError as error:
        raise InputError(f"{path} is damaged ({error}); train this submap again.") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise InputError(f"{path} does not describe a submap model; choose a folder that `nvsim train` wrote.")
    if data.get("version") != VERSION:
        raise InputError(
            f"{path} has version {data.get('version')}, but this program reads version {VERSION}; update the program."
        )
    return data


def _check_sizes(folder: Path, files: dict[str, Any]) -> None:
    # Before anything is read: a file that was cut off says so at once.
    for name in (GAUSSIANS, NETWORKS):
        if (folder / name).stat().st_size != files[name]["bytes"]:
            raise InputError(f"{folder / name} is not as it was written; train this submap again.")


def _check(path: Path, digest: str | None, files: dict[str, Any]) -> None:
    if digest != files[path.name]["sha256"]:
        raise InputError(f"{path} is not as it was written; train this submap again.")


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
        "background": None if background is None else {"octaves": background.octaves, "period": background.period},
        "texture": None
        if texture is None
        else {
            "levels": len(texture.levels),
            "low": list(map(float, texture.low)),
            "high": list(map(float, texture.high)),
        },
        "floor": {"origin": list(map(float, model.floor.origin)), "spacing": float(model.floor.spacing)},
        "info": model.info,
    }


def _tensors(model: SubmapModel) -> dict[str, np.ndarray]:
    tensors = {"floor.heights": model.floor.heights}
    if model.background is not None:
        tensors |= {f"background.{name}": w for name, w in model.background.weights.items()}
    if model.texture is not None:
        tensors |= {f"texture.{i}": level for i, level in enumerate(model.texture.levels)}
    return {name: np.ascontiguousarray(array, np.float32) for name, array in tensors.items()}


def _background(data: dict[str, Any] | None, tensors: dict[str, np.ndarray]) -> Background | None:
    if data is None:
        return None
    prefix = "background."
    weights = {name.removeprefix(prefix): _owned(w) for name, w in tensors.items() if name.startswith(prefix)}
    return Background(weights, int(data["octaves"]), float(data["period"]))


def _texture(data: dict[str, Any] | None, tensors: dict[str, np.ndarray]) -> FloorTexture | None:
    if data is None:
        return None
    levels = tuple(_owned(tensors[f"texture.{i}"]) for i in range(int(data["levels"])))
    return FloorTexture(levels, _pair(data["low"]), _pair(data["high"]))


def _owned(array: np.ndarray) -> np.ndarray:
    # A copy, because what the file library hands out may be read-only.
    return np.array(array, np.float32, order="C")


def _pair(values: Any) -> tuple[float, float]:
    first, second = values
    return float(first), float(second)


def _fingerprint(path: Path) -> dict[str, Any]:
    with open(path, "rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"bytes": path.stat().st_size, "sha256": digest}


@contextlib.contextmanager
def _replacing_folder(folder: Path) -> Iterator[Path]:
    """Yields a temporary folder beside `folder`; on success it takes its place, on failure nothing is left."""
    atomic.make_folder(folder.parent)
    prefix = f".{folder.name}-"
    for stale in folder.parent.glob(f"{prefix}*"):
        shutil.rmtree(stale, ignore_errors=True)  # of a process that was killed
    try:
        place = Path(tempfile.mkdtemp(prefix=prefix, dir=folder.parent))
    except OSError as error:
        raise atomic.as_input_error(folder, error) from error
    try:
        place.chmod(0o755)
        yield place
        if folder.exists():
            folder.rename(place.with_name(place.name + "-old"))
        place.rename(folder)
    except OSError as error:
        raise atomic.as_input_error(folder, error) from error
    finally:
        for left in folder.parent.glob(f"{place.name}*"):
            shutil.rmtree(left, ignore_errors=True)
