"""A capture on disk: capture.json (frames, lenses, poses, alignment) and the cloud beside it as .npz."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim import atomic
from nvsim.capture.types import Alignment, Capture, Cloud, Frame
from nvsim.errors import InputError
from nvsim.geometry.lens import Lens

VERSION = 1


def save_capture(capture: Capture, folder: Path) -> None:
    """Writes capture.json and, where there is a cloud, cloud-HASH.npz. capture.json names the cloud and is written
    last, so that the two always belong together. Raises InputError when the disk refuses."""
    cloud_name = None
    if capture.cloud is not None:
        cloud_name = f"cloud-{_cloud_hash(capture.cloud).hexdigest()[:16]}.npz"
        arrays: dict[str, NDArray[np.generic]] = {"points": capture.cloud.points}
        if capture.cloud.colors is not None:
            arrays["colors"] = capture.cloud.colors
        with atomic.replacing(folder / cloud_name) as temporary, open(temporary, "wb") as out:
            np.savez(out, **arrays)  # type: ignore[arg-type]
    lenses = list(dict.fromkeys(f.lens for f in capture.frames))
    number = {lens: i for i, lens in enumerate(lenses)}
    tree = {
        "version": VERSION,
        "source": str(capture.source),
        "format": capture.format,
        "alignment": {
            "rotation": capture.alignment.rotation.tolist(),
            "scale": capture.alignment.scale,
            "scale_known": capture.alignment.scale_known,
        },
        "cloud": None if capture.cloud is None else {"file": cloud_name, "kind": capture.cloud.kind},
        "lenses": [{"model": n.model, "width": n.width, "height": n.height, "params": n.params} for n in lenses],
        "frames": [
            {
                "name": f.name,
                "image": str(f.image_path.absolute()),
                "lens": number[f.lens],
                "camera_to_world": f.camera_to_world.tolist(),
                "sensor": f.sensor,
                "timestamp": f.timestamp,
            }
            for f in capture.frames
        ],
    }
    atomic.write_text(folder / "capture.json", json.dumps(tree, indent=1))
    for other in folder.glob("cloud-*.npz"):
        if other.name != cloud_name:
            other.unlink(missing_ok=True)


def load_capture(folder: Path) -> Capture:
    """The capture of `save_capture`, equal in every number. Raises InputError when it is missing, broken or of a newer
    version."""
    path = folder / "capture.json"
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        version = tree["version"]
    except OSError as error:
        raise InputError(f"Cannot read {path} ({error.strerror}); import the capture again.") from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"{path} is not a stored capture; import the capture again.") from error
    if version != VERSION:
        raise InputError(f"{path} has version {version}, this program reads {VERSION}; update the program.")
    try:
        return _parse(tree, folder)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise InputError(f"{path} is damaged ({type(error).__name__}: {error}); import the capture again.") from error


def _parse(tree: dict[str, Any], folder: Path) -> Capture:
    lenses = [Lens(n["model"], n["width"], n["height"], tuple(n["params"])) for n in tree["lenses"]]
    frames = tuple(
        Frame(
            f["name"],
            Path(f["image"]),
            lenses[f["lens"]],
            np.array(f["camera_to_world"], np.float64).reshape(4, 4),
            f["sensor"],
            float(f["timestamp"]),
        )
        for f in tree["frames"]
    )
    alignment = Alignment(
        np.array(tree["alignment"]["rotation"], np.float64).reshape(3, 3),
        float(tree["alignment"]["scale"]),
        bool(tree["alignment"]["scale_known"]),
    )
    cloud = None if tree["cloud"] is None else _load_cloud(folder / tree["cloud"]["file"], tree["cloud"]["kind"])
    return Capture(Path(tree["source"]), tree["format"], frames, cloud, alignment)


def _load_cloud(path: Path, kind: str) -> Cloud:
    import zipfile

    try:
        with np.load(path, allow_pickle=False) as arrays:
            return Cloud(arrays["points"], arrays["colors"] if "colors" in arrays.files else None, kind)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(f"{path} is missing or damaged; import the capture again.") from error


def fingerprint(capture: Capture) -> str:
    """sha256 of what a stage depends on: poses, lenses, names, sizes and modification times of the images, cloud,
    alignment. An image that is missing counts as such."""
    state = hashlib.sha256()
    for f in capture.frames:
        try:
            status = f.image_path.stat()
            stamp = (status.st_size, status.st_mtime_ns)
        except OSError:
            stamp = (-1, -1)
        words = [f.name, str(f.image_path), f.sensor, f.timestamp, f.lens.model, f.lens.width, f.lens.height]
        state.update(json.dumps([*words, f.lens.params, stamp]).encode())
        state.update(np.ascontiguousarray(f.camera_to_world).tobytes())
    state.update(np.ascontiguousarray(capture.alignment.rotation).tobytes())
    state.update(json.dumps([capture.alignment.scale, capture.alignment.scale_known]).encode())
    if capture.cloud is not None:
        state.update(_cloud_hash(capture.cloud).digest())
    return state.hexdigest()


def _cloud_hash(cloud: Cloud) -> hashlib._Hash:
    state = hashlib.sha256(cloud.kind.encode())
    state.update(np.ascontiguousarray(cloud.points).tobytes())
    if cloud.colors is not None:
        state.update(np.ascontiguousarray(cloud.colors).tobytes())
    return state
