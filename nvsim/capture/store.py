"""Save and load a capture: capture.json (frames, lenses, poses, alignment) and the point cloud as .npz."""

from __future__ import annotations

import hashlib
import json
import math
import re
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.raw import LARGEST_SIDE
from nvsim.capture.types import Alignment, Capture, Cloud, CloudKind, DepthFile, Frame, MaskFile
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import read_bytes
from nvsim.files.reading import reading
from nvsim.files.stored_arrays import read_arrays, write_arrays
from nvsim.geometry.lens import Lens
from nvsim.geometry.rotation import is_rigid

VERSION = 1
_AGAIN = "import the capture again"
_FARTHEST = 1e10  # meters; a large scale may give more meters than FARTHEST allows source units


def save_capture(capture: Capture, folder: Path) -> None:
    """Write capture.json and, if there is a point cloud, cloud-HASH.npz.

    capture.json names the point cloud and is written last, so the two files always match. Raises InputError if they
    cannot be written."""
    cloud_name = None
    if capture.cloud is not None:
        cloud_name = f"cloud-{_cloud_hash(capture.cloud).hexdigest()[:16]}.npz"
        arrays: dict[str, NDArray[np.generic]] = {"points": capture.cloud.points}
        if capture.cloud.colors is not None:
            arrays["colors"] = capture.cloud.colors
        write_arrays(folder / cloud_name, arrays, compressed=False)
    lenses = list(dict.fromkeys([*(f.lens for f in capture.frames), *(d.lens for d in capture.depths)]))
    number = {lens: i for i, lens in enumerate(lenses)}
    tree = {
        "version": VERSION,
        "source": str(capture.source),
        "format": capture.format,
        "alignment": {
            "rotation": capture.alignment.rotation.tolist(),
            "scale": capture.alignment.scale,
            "scale_known": capture.alignment.scale_known,
            "origin": list(capture.alignment.origin),
        },
        "cloud": None if capture.cloud is None else {"file": cloud_name, "kind": capture.cloud.kind},
        "lenses": [
            {
                "model": n.model,
                "width": n.width,
                "height": n.height,
                "params": n.params,
                **({"turns": n.turns} if n.turns else {}),
                **({"border": n.border} if any(n.border) else {}),
            }
            for n in lenses
        ],
        "frames": [
            {
                "name": f.name,
                "image": str(f.image_path.absolute()),
                "lens": number[f.lens],
                "camera_to_world": f.camera_to_world.tolist(),
                "sensor": f.sensor,
                "timestamp": f.timestamp,
                **({} if f.mask is None else {"mask": str(f.mask.path.absolute()), "ignored": f.mask.ignored}),
                **({"rig": f.rig} if f.rig else {}),
            }
            for f in capture.frames
        ],
        "depths": [
            {
                "file": str(d.path.absolute()),
                "lens": number[d.lens],
                "camera_to_world": d.camera_to_world.tolist(),
                "frame": d.frame,
                "is_raw": d.is_raw,
                "scale": d.scale,
                "unit": d.unit,
                **({} if d.confidence is None else {"confidence": str(d.confidence.absolute())}),
            }
            for d in capture.depths
        ],
        **({} if capture.places is None else {"places": capture.places.tolist()}),
    }
    atomic.write_text(folder / "capture.json", json.dumps(tree, indent=1))
    for other in folder.glob("cloud-*.npz"):
        if other.name != cloud_name:
            other.unlink(missing_ok=True)


def load_capture(folder: Path) -> Capture:
    """The capture that `save_capture` stored, with all numbers equal. Raises InputError if it is missing, damaged, or
    of a newer version."""
    path = folder / "capture.json"
    data = read_bytes(path)
    with reading(path, "a stored capture", _AGAIN):
        tree = json.loads(data.decode())
        if not isinstance(tree, dict) or type(tree.get("version")) is not int:
            raise InputError(f"{path} is not a stored capture; {_AGAIN}.")
        if tree["version"] != VERSION:
            raise InputError(f"{path} has version {tree['version']}, this program reads {VERSION}; update the program.")
    with reading(path, "a stored capture", f"it is damaged, so {_AGAIN}"):
        return _parse(tree, folder)


def _parse(tree: dict[str, Any], folder: Path) -> Capture:
    lenses = [_lens(n) for n in tree["lenses"]]
    frames = tuple(
        Frame(
            _text(f["name"]),
            Path(_text(f["image"])),
            lenses[f["lens"]],
            _pose(f["camera_to_world"]),
            _text(f["sensor"]),
            _finite(f["timestamp"]),
            _mask(f),
            rig=_text(f["rig"]) if "rig" in f else "",
        )
        for f in tree["frames"]
    )
    places = _places(tree["places"]) if "places" in tree else None
    if (not frames) != (places is not None) or len({f.name for f in frames}) < len(frames):
        raise ValueError("no frame, or a duplicate name")
    rotation = np.array(tree["alignment"]["rotation"], np.float64).reshape(3, 3)
    scale = _finite(tree["alignment"]["scale"])
    x, y, z = (_finite(v) for v in tree["alignment"].get("origin", (0, 0, 0)))  # the key may be absent
    if not np.isfinite(rotation).all() or scale <= 0:
        raise ValueError("an invalid alignment")
    alignment = Alignment(rotation, scale, bool(tree["alignment"]["scale_known"]), (x, y, z))
    cloud = None if tree["cloud"] is None else _load_cloud(folder, tree["cloud"]["file"], _text(tree["cloud"]["kind"]))
    depths = tuple(_depth(d, lenses) for d in tree.get("depths", ()))  # the key may be absent
    return Capture(Path(_text(tree["source"])), _text(tree["format"]), frames, cloud, alignment, (), depths, places)


def _places(rows: object) -> NDArray[np.float64]:
    found = np.array(rows, np.float64).reshape(-1, 3)
    if not len(found) or not (np.abs(found) <= _FARTHEST).all():
        raise ValueError("places that are missing or not finite")
    return found


def _mask(tree: dict[str, Any]) -> MaskFile | None:
    if "mask" not in tree:
        return None
    ignored = tree["ignored"]
    if ignored not in ("black", "white", "transparent"):
        raise ValueError("a mask whose ignored value is neither black, white, nor transparent")
    return MaskFile(Path(_text(tree["mask"])), ignored)


def _depth(tree: dict[str, Any], lenses: list[Lens]) -> DepthFile:
    frame, scale, unit = tree["frame"], _finite(tree["scale"]), _finite(tree["unit"])
    if not isinstance(frame, str) or scale <= 0 or unit <= 0:
        raise ValueError("a depth image without a frame or a scale")
    pose = _pose(tree["camera_to_world"])
    confidence = Path(_text(tree["confidence"])) if "confidence" in tree else None
    file, lens = Path(_text(tree["file"])), lenses[tree["lens"]]
    return DepthFile(file, lens, pose, frame, bool(tree["is_raw"]), scale, unit, confidence)


def _text(value: object) -> str:
    if not isinstance(value, str) or not value or "\0" in value:
        raise ValueError(f"{str(value)[:40]!r} is not a name")
    return value


def _finite(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{number} is not finite")
    return number


def _lens(tree: dict[str, Any]) -> Lens:
    size = tree["width"], tree["height"]
    if not all(type(side) is int and 0 < side <= LARGEST_SIDE for side in size):
        raise ValueError("an invalid image size")
    turns, (left, top, right, bottom) = tree.get("turns", 0), tree.get("border", (0, 0, 0, 0))  # may be absent
    if not all(type(number) is int for number in (turns, left, top, right, bottom)):
        raise ValueError("quarter turns or a border that are not whole numbers")
    params = tuple(_finite(p) for p in tree["params"])
    lens = Lens(_text(tree["model"]), *size, params, turns, (left, top, right, bottom))
    if min(lens.focal) <= 0:
        raise ValueError("a focal length that is not positive")
    return lens


def _pose(rows: object) -> NDArray[np.float64]:
    pose = np.array(rows, np.float64).reshape(4, 4)
    if not (np.isfinite(pose).all() and is_rigid(pose) and np.abs(pose).max() <= _FARTHEST):
        raise ValueError("a pose that is not rigid, or too far")
    return pose


def _load_cloud(folder: Path, name: object, stored_kind: str) -> Cloud:
    kind = next((k for k in get_args(CloudKind) if k == stored_kind), None)
    if kind is None:
        raise ValueError(f"a cloud of the kind {stored_kind[:40]!r}")
    if not isinstance(name, str) or not re.fullmatch(r"cloud-[0-9a-f]{1,64}\.npz", name):
        raise ValueError("a cloud outside the project")
    wanted = {"points": ("f", 2), "colors": ("u", 2)}
    arrays = read_arrays(folder / name, "a stored cloud", wanted, _AGAIN, frozenset({"colors"}))
    points, colors = arrays["points"], arrays.get("colors")
    if points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError("invalid points")
    if colors is not None and (colors.shape != points.shape or colors.dtype != np.uint8):
        raise ValueError("colors that do not match the points")
    return Cloud(points.astype(np.float32, copy=False), colors, kind)


def fingerprint(capture: Capture) -> str:
    """sha256 of everything that a stage depends on: poses, lenses, point cloud, alignment; and names, sizes, and
    modification times of images, masks, and depth images. A missing file changes the fingerprint."""
    state = hashlib.sha256()
    for f in capture.frames:
        words = [f.name, str(f.image_path), f.sensor, f.timestamp, f.lens.model, f.lens.width, f.lens.height]
        masked = [] if f.mask is None else [str(f.mask.path), f.mask.ignored, _stamp(f.mask.path)]
        turned = _turns_and_border(f.lens)
        state.update(json.dumps([*words, f.lens.params, _stamp(f.image_path), *masked, *turned]).encode())
        state.update(np.ascontiguousarray(f.camera_to_world).tobytes())
    state.update(np.ascontiguousarray(capture.alignment.rotation).tobytes())
    origin = list(capture.alignment.origin) if any(capture.alignment.origin) else []
    state.update(json.dumps([capture.alignment.scale, capture.alignment.scale_known, *origin]).encode())
    if capture.cloud is not None:
        state.update(_cloud_hash(capture.cloud).digest())
    for d in capture.depths:
        lens = [d.lens.model, d.lens.width, d.lens.height, d.lens.params]
        own = [] if d.confidence is None else [str(d.confidence), _stamp(d.confidence)]
        turned = _turns_and_border(d.lens)
        words = [str(d.path), d.frame, d.is_raw, d.scale, d.unit, *lens, _stamp(d.path), *own, *turned]
        state.update(json.dumps(words).encode())
        state.update(np.ascontiguousarray(d.camera_to_world).tobytes())
    return state.hexdigest()


def _turns_and_border(lens: Lens) -> list[object]:
    return ([lens.turns] if lens.turns else []) + ([lens.border] if any(lens.border) else [])


def _stamp(path: Path) -> tuple[int, int]:
    """Size in bytes and modification time of a file in nanoseconds; (-1, -1) if it is missing."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return -1, -1
    return status.st_size, status.st_mtime_ns


def _cloud_hash(cloud: Cloud) -> hashlib._Hash:
    state = hashlib.sha256(cloud.kind.encode(errors="surrogatepass"))
    state.update(np.ascontiguousarray(cloud.points).tobytes())
    if cloud.colors is not None:
        state.update(np.ascontiguousarray(cloud.colors).tobytes())
    return state
