"""Equirectangular panoramas with given poses (camera_model EQUIRECTANGULAR of a transforms.json): cut into level views
with the poses and lenses that follow, as a transforms.json that is read like any other.

Axes are nerfstudio's: the middle of a panorama looks along -z of its camera, and +y is up.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.capture import json_tree, nerfstudio
from nvsim.capture.nerfstudio_fields import LENS_FIELDS
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress
from nvsim.files import atomic
from nvsim.files.decoding import decoded
from nvsim.files.reading import reading
from nvsim.files.regular import is_regular, read_bytes, read_json
from nvsim.footage.sources import is_equirectangular

if TYPE_CHECKING:
    from nvsim.footage.views import Views

MODEL = "EQUIRECTANGULAR"
STAGE = "poses"
_MARK = "panoramas.json"
_CAPTURE = "transforms.json"
_QUALITY = 95  # of JPEG
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenGL's axes of a camera from OpenCV's, and back
_DROPPED = ("depth_file_path", "depth_path")


def find_posed_panoramas(path: Path) -> Path | None:
    """The transforms.json at `path`, a file or a folder, if its camera model is EQUIRECTANGULAR; None for everything
    else."""
    with suppress(InputError, OSError, ValueError):
        file = nerfstudio.find(path) if path.exists() else None
        if file is not None and file.is_file() and _is_equirectangular(json_tree.load_object(file)):
            return file
    return None


def _is_equirectangular(tree: dict[str, Any]) -> bool:
    frames = tree.get("frames")
    if not isinstance(frames, list) or not frames:
        return False
    return all(isinstance(f, dict) and {**tree, **f}.get("camera_model") == MODEL for f in frames)


def belongs_to(folder: Path, file: Path) -> bool:
    """Whether `folder` holds the views of the panoramas that `file` lists, perhaps unfinished ones."""
    mark = _mark(folder)
    return mark is not None and mark["files"] == _stamp(file)


def is_used(folder: Path) -> bool:
    """Whether `folder` holds views of any posed panoramas."""
    return is_regular(folder / _MARK)


def _mark(folder: Path) -> dict[str, Any] | None:
    if not is_used(folder):
        return None
    mark = read_json(folder / _MARK, "a note about panoramas", "remove the folder")
    with reading(folder / _MARK, "a note about panoramas", "remove the folder"):
        return {"files": list(mark["files"]), "whole": bool(mark["whole"])}


def cut_posed_panoramas(file: Path, folder: Path, listen: Listener) -> None:
    """Makes `folder` a capture of the views of all panoramas in `file`: images, masks if there are any, and
    transforms.json. If it is finished for the same files, it is used as it is. Depth images are left out, because a
    panorama has distances along rays. Raises InputError for a frame without an image, a pose or the right proportions,
    and if the folder holds another capture."""
    from nvsim.footage.views import views_of  # imports OpenCV, which the window's start avoids

    mark, stamp = _mark(folder), _stamp(file)
    if mark == {"files": stamp, "whole": True} and (folder / _CAPTURE).is_file():
        listen(Log(f"The views in {folder} are up to date.", STAGE))
        return
    there = any((folder / name).exists() for name in ("images", "masks", "sparse", _CAPTURE))
    ours = mark is not None and not mark["whole"] and mark["files"][:1] == stamp[:1]  # unfinished, of the same list
    if there and not ours:
        raise InputError(f"{folder} holds another capture; choose another folder or remove it.")
    tree = json_tree.load_object(file)
    entries: list[dict[str, Any]] = tree["frames"]
    names = _names(file, entries)
    atomic.make_folder(folder)
    atomic.write_text(folder / _MARK, json.dumps({"files": stamp, "whole": False}))
    frames, views = list[dict[str, Any]](), None
    for index, (entry, name) in enumerate(zip(entries, names, strict=True)):
        listen(Progress(STAGE, index, len(entries), "cut panoramas into views"))
        where = f"{file.name}, frame {index} ({entry['file_path']})"
        image = _image(file, str(entry["file_path"]), where)
        views = views_of(image.shape[0]) if views is None else views
        pose = json_tree.matrix(entry.get("transform_matrix"), where)
        mask = _mask(file, tree, entry)
        frames += _cut(entry, name, pose, image, mask, views, folder)
    assert views is not None
    center = views.size / 2
    kept = {key: value for key, value in tree.items() if key not in (*LENS_FIELDS, *_DROPPED, "mask_path", "frames")}
    if isinstance(cloud := kept.get("ply_file_path"), str):
        kept["ply_file_path"] = str((file.parent / cloud).absolute())
    lens = {"w": views.size, "h": views.size, "fl_x": views.focal, "fl_y": views.focal, "cx": center, "cy": center}
    atomic.write_text(
        folder / _CAPTURE, json.dumps({"camera_model": "PINHOLE", **lens, **kept, "frames": frames}, indent=1)
    )
    atomic.write_text(folder / _MARK, json.dumps({"files": stamp, "whole": True}))
    if any(entry.get(field) for entry in entries for field in _DROPPED):
        listen(Log("Depth images of panoramas are not used.", STAGE))
    listen(Done(STAGE, f"{len(entries)} panoramas are cut into {len(frames)} views", {"frames": len(frames)}))


def _names(file: Path, entries: list[dict[str, Any]]) -> list[str]:
    """A name for each frame, none twice. Raises InputError for a frame without a file."""
    for index, entry in enumerate(entries):
        if not isinstance(entry.get("file_path"), str) or not entry["file_path"]:
            raise InputError(f"{file}, frame {index}: the field 'file_path' is missing; add it.")
    stems = [Path(entry["file_path"].replace("\\", "/")).stem for entry in entries]
    if len(set(stems)) == len(stems):
        return stems
    return [f"{index:06d}_{stem}" for index, stem in enumerate(stems)]


def _image(file: Path, listed: str, where: str) -> NDArray[np.uint8]:
    """(H, 2H, 3) uint8 BGR."""
    import cv2

    image = decoded(read_bytes(file.parent / listed.replace("\\", "/")), file.parent / listed, cv2.IMREAD_COLOR)
    height, width = image.shape[:2]
    if not is_equirectangular(width, height):
        raise InputError(
            f"{where}: the image is {width}x{height} pixels, but an equirectangular panorama is twice as wide as high; "
            "correct camera_model."
        )
    return np.asarray(image, np.uint8)


def _mask(file: Path, tree: dict[str, Any], entry: dict[str, Any]) -> NDArray[np.uint8] | None:
    """(H, W) uint8 of a frame, or that of all frames; black is ignored."""
    import cv2

    listed = {"mask_path": tree.get("mask_path"), **entry}.get("mask_path")
    if not isinstance(listed, str) or not listed:
        return None
    path = file.parent / listed.replace("\\", "/")
    return np.asarray(decoded(read_bytes(path), path, cv2.IMREAD_GRAYSCALE, what="a mask"), np.uint8)


def _cut(
    entry: dict[str, Any],
    name: str,
    pose: NDArray[np.float64],
    image: NDArray[np.uint8],
    mask: NDArray[np.uint8] | None,
    views: Views,
    folder: Path,
) -> Iterator[dict[str, Any]]:
    """Writes the views of one panorama; the entries of a transforms.json that list them. `pose` (4, 4) is the camera to
    world, OpenGL axes."""
    import cv2

    from nvsim.footage.views import cut

    masks = [None] * views.count if mask is None else cut(mask, views, nearest=True)
    kept = {key: value for key, value in entry.items() if key not in (*LENS_FIELDS, *_DROPPED, "mask_path")}
    for place, turn, view, own in zip(views.names(name), views.turns, cut(image, views), masks, strict=True):
        _write(folder / "images" / f"{place}.jpg", cv2.imencode(".jpg", view, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1])
        listed = {**kept, "file_path": f"images/{place}.jpg"}
        if own is not None:
            _write(folder / "masks" / f"{place}.png", cv2.imencode(".png", own)[1])
            listed["mask_path"] = f"masks/{place}.png"
        to_panorama = np.eye(4)
        to_panorama[:3, :3] = turn.T
        yield {**listed, "transform_matrix": (pose @ _FLIP @ to_panorama @ _FLIP).tolist()}


def _write(path: Path, encoded: NDArray[np.uint8]) -> None:
    atomic.make_folder(path.parent)
    atomic.write_bytes(path, encoded.tobytes())


def _stamp(file: Path) -> list[list[Any]]:
    """Path, bytes and time of change (nanoseconds) of the list and of its images; missing ones are left out."""
    tree = json_tree.load_object(file)
    images = [file.parent / str(entry.get("file_path", "")).replace("\\", "/") for entry in tree["frames"]]
    found = [(path.absolute(), path.stat()) for path in (file, *images) if path.is_file()]
    return [[str(path), stat.st_size, stat.st_mtime_ns] for path, stat in found]
