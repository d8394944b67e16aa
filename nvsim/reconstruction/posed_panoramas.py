"""Convert equirectangular panoramas with given poses to a capture of perspective views with poses and lenses.

The input is a transforms.json with camera_model EQUIRECTANGULAR. The output is an ordinary transforms.json. The axes
are nerfstudio's: the center of a panorama looks along -z of its camera, and +y is up.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.capture import nerfstudio, nerfstudio_fields
from nvsim.capture.nerfstudio_fields import LENS_FIELDS
from nvsim.capture.types import MaskFile
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress
from nvsim.files import atomic
from nvsim.files.images import decode_pixels
from nvsim.files.opening import is_regular, read_bytes, read_json
from nvsim.files.reading import reading
from nvsim.files.records import record_of
from nvsim.footage.cut_options import MASKS, VIEWS, WHOLE, CutOptions, refuse_mask_in_output
from nvsim.footage.sources import Stamp, is_equirectangular

if TYPE_CHECKING:
    from nvsim.footage.views import Views

MODEL = "EQUIRECTANGULAR"
STAGE = "poses"
_MARK = "panoramas.json"
_CAPTURE = "transforms.json"
_MADE = ("images", MASKS, _CAPTURE)
_QUALITY = 95  # JPEG quality
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # between OpenCV and OpenGL camera axes
_DROPPED = ("depth_file_path", "depth_path")


def find_posed_panoramas(path: Path) -> Path | None:
    """The transforms.json at `path`, a file or a folder, if its camera model is EQUIRECTANGULAR. None for all other
    paths."""
    with suppress(InputError, OSError, ValueError):
        file = nerfstudio.find(path) if path.exists() else None
        if file is not None and file.is_file() and _is_equirectangular(nerfstudio_fields.load_object(file)):
            return file
    return None


def _is_equirectangular(tree: dict[str, Any]) -> bool:
    frames = tree.get("frames")
    if not isinstance(frames, list) or not frames:
        return False
    return all(isinstance(f, dict) and {**tree, **f}.get("camera_model") == MODEL for f in frames)


def has_views_of(folder: Path, file: Path, options: CutOptions | None = None) -> bool:
    """Whether `folder` has the views of the panoramas that `file` lists, finished or not. If `options` are given, the
    views must also agree with them."""
    mark = _mark(folder)
    return mark is not None and mark.files == _stamp(file) and mark.agrees(options)


def has_panorama_views(folder: Path) -> bool:
    """Whether `folder` has views of posed panoramas."""
    return is_regular(folder / _MARK)


@dataclass(frozen=True)
class _PanoramaRecord:
    """The record of panoramas whose views are in a folder.

    files  stamps of the list and of its images
    whole  whether all views are finished
    views  number of views of each panorama
    mask   stamp of the mask that the user gave, empty without one
    """

    files: Stamp
    whole: bool
    views: int = VIEWS
    mask: Stamp = ()

    def agrees(self, options: CutOptions | None) -> bool:
        return options is None or options.agrees(self.views, self.mask)


def _mark(folder: Path) -> _PanoramaRecord | None:
    if not has_panorama_views(folder):
        return None
    data = read_json(folder / _MARK, "a record of panoramas", "remove the folder")
    with reading(folder / _MARK, "a record of panoramas", "remove the folder"):
        return record_of(_PanoramaRecord, data)


def _write_mark(mark: _PanoramaRecord, folder: Path) -> None:
    atomic.write_text(folder / _MARK, json.dumps(asdict(mark)))


def cut_posed_panoramas(file: Path, folder: Path, listen: Listener, options: CutOptions | None = None) -> None:
    """Writes the views of all panoramas in `file` to `folder` as a capture: images, masks if any, and transforms.json.

    If it is finished for these files and `options`, it is reused. Without options, the previous ones are kept. Depth
    images are skipped, because those of panoramas have distances along rays. Raises InputError for a frame without an
    image, without a pose, or with other proportions, and if the folder contains another capture."""
    from nvsim.footage.carrier import PanoramaSamples, as_png, cut_mask, read_panorama_mask
    from nvsim.footage.views import views_of  # imports OpenCV, which would slow the start of the window

    refuse_mask_in_output(options, folder)
    mark, stamp = _mark(folder), _stamp(file)
    if mark is not None and mark.whole and mark.files == stamp and mark.agrees(options) and _is_capture(folder):
        listen(Log(f"The views in {folder} are up to date.", STAGE))
        return
    there = any((folder / name).exists() for name in (*_MADE, "sparse"))
    same_list = mark is not None and mark.files[:1] == stamp[:1]
    ours = mark is not None and (mark.files == stamp if mark.whole else same_list)
    if there and not ours:
        raise InputError(f"{folder} contains another capture; choose another folder or remove it.")
    if options is None and mark is not None:
        options = CutOptions(mark.views, Path(mark.mask[0][0]) if mark.mask else None)
    options = CutOptions() if options is None else options
    usable = None if options.mask is None else read_panorama_mask(options.mask)
    tree = nerfstudio_fields.load_object(file)
    entries: list[dict[str, Any]] = tree["frames"]
    names = _names(file, entries)
    atomic.make_folder(folder)
    begun = _PanoramaRecord(stamp, False, options.count, options.stamp)
    _write_mark(begun, folder)
    _remove_made(folder)
    frames, views, samples = list[list[dict[str, Any]]](), None, PanoramaSamples()
    for index, (entry, name) in enumerate(zip(entries, names, strict=True)):
        listen(Progress(STAGE, index, len(entries), "cut panoramas into views"))
        where = f"{file.name}, frame {index} ({entry['file_path']})"
        image = _image(file, str(entry["file_path"]), where)
        views = views_of(image.shape[0], options.count) if views is None else views
        pose = nerfstudio_fields.matrix(entry.get("transform_matrix"), where)
        samples.add(image)
        frames.append(list(_cut(entry, name, pose, image, views, folder)))
    assert views is not None
    usable = samples.usable() if usable is None else usable
    everywhere = None if usable is None else cut_mask(usable, views)
    if usable is not None:
        _write(folder / MASKS / WHOLE, as_png(usable))
    masked = list[float]()
    for entry, name, own in zip(entries, names, frames, strict=True):
        masked += _mask_views(name, _mask(file, tree, entry), everywhere, own, views, folder)
    center = views.size / 2
    kept = {key: value for key, value in tree.items() if key not in (*LENS_FIELDS, *_DROPPED, "mask_path", "frames")}
    if isinstance(cloud := kept.get("ply_file_path"), str):
        kept["ply_file_path"] = str((file.parent / cloud).absolute())
    lens = {"w": views.size, "h": views.size, "fl_x": views.focal, "fl_y": views.focal, "cx": center, "cy": center}
    # Every eighth frame is held out. Each panorama starts with another view, so that no view is always held out.
    listed = [entry for k, own in enumerate(frames) for entry in own[k % views.count :] + own[: k % views.count]]
    atomic.write_text(
        folder / _CAPTURE, json.dumps({"camera_model": "PINHOLE", **lens, **kept, "frames": listed}, indent=1)
    )
    _write_mark(replace(begun, whole=True), folder)
    if any(entry.get(field) for entry in entries for field in _DROPPED):
        listen(Log("Depth images of panoramas are not used.", STAGE))
    if masked:
        listen(Log(f"{100 * sum(masked) / len(listed):.1f} % of the pixels of the views are masked.", STAGE))
    listen(Done(STAGE, f"{len(entries)} panoramas are cut into {len(listed)} views", {"frames": len(listed)}))


def _is_capture(folder: Path) -> bool:
    return (folder / _CAPTURE).is_file()


def _remove_made(folder: Path) -> None:
    try:
        for name in _MADE:
            atomic.remove(folder / name)
    except OSError as error:
        raise atomic.as_input_error(folder, error) from error


def _names(file: Path, entries: list[dict[str, Any]]) -> list[str]:
    """A unique name for each frame. Raises InputError for a frame without a file."""
    for index, entry in enumerate(entries):
        if not isinstance(entry.get("file_path"), str) or not entry["file_path"]:
            raise InputError(f"{file}, frame {index}: the field 'file_path' is missing; add it.")
    stems = [Path(entry["file_path"].replace("\\", "/")).stem for entry in entries]
    if len(set(stems)) == len(stems):
        return stems
    return [f"{index:06d}_{stem}" for index, stem in enumerate(stems)]


def _image(file: Path, listed: str, where: str) -> NDArray[np.uint8]:
    """Reads a panorama, (H, 2H, 3) uint8 BGR."""
    import cv2

    image = decode_pixels(read_bytes(file.parent / listed.replace("\\", "/")), file.parent / listed, cv2.IMREAD_COLOR)
    height, width = image.shape[:2]
    if not is_equirectangular(width, height):
        raise InputError(
            f"{where}: the image is {width}x{height} pixels, but an equirectangular panorama is twice as wide as high; "
            "correct camera_model."
        )
    return np.asarray(image, np.uint8)


def _mask(file: Path, tree: dict[str, Any], entry: dict[str, Any]) -> NDArray[np.bool_] | None:
    """The mask (H, W) of a frame, or the mask of all frames. False pixels are ignored."""
    from nvsim.capture.masks import decode_mask

    listed = {"mask_path": tree.get("mask_path"), **entry}.get("mask_path")
    if not isinstance(listed, str) or not listed:
        return None
    return decode_mask(MaskFile(file.parent / listed.replace("\\", "/")))


def _cut(
    entry: dict[str, Any], name: str, pose: NDArray[np.float64], image: NDArray[np.uint8], views: Views, folder: Path
) -> Iterator[dict[str, Any]]:
    """Writes the views of one panorama. Yields their entries for a transforms.json. `pose` (4, 4) is camera to world
    with OpenGL axes."""
    import cv2

    from nvsim.footage.views import cut_views

    kept = {key: value for key, value in entry.items() if key not in (*LENS_FIELDS, *_DROPPED, "mask_path")}
    for place, turn, view in zip(views.names(name), views.turns, cut_views(image, views), strict=True):
        encoded = cv2.imencode(".jpg", view, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
        _write(folder / "images" / f"{place}.jpg", encoded.tobytes())
        to_panorama = np.eye(4)
        to_panorama[:3, :3] = turn.T
        listed = {**kept, "file_path": f"images/{place}.jpg"}
        yield {**listed, "transform_matrix": (pose @ _FLIP @ to_panorama @ _FLIP).tolist()}


def _mask_views(
    name: str,
    own: NDArray[np.bool_] | None,
    everywhere: list[NDArray[np.bool_]] | None,
    listed: list[dict[str, Any]],
    views: Views,
    folder: Path,
) -> Iterator[float]:
    """Writes the masks of the views of one panorama and adds them to their entries `listed`. Yields the ignored share
    of each view. Pixels are ignored if `own` (H, 2H), the mask of the panorama, or `everywhere`, the masks of the views
    of all panoramas, ignores them."""
    from nvsim.footage.carrier import as_png, cut_mask

    both = [masks for masks in (everywhere, None if own is None else cut_mask(own, views)) if masks is not None]
    if not both:
        return
    for place, entry, *masks in zip(views.names(name), listed, *both, strict=True):
        mask = np.logical_and.reduce(masks)
        _write(folder / MASKS / f"{place}.png", as_png(mask))
        entry["mask_path"] = f"{MASKS}/{place}.png"
        yield float(np.mean(~mask))


def _write(path: Path, data: bytes) -> None:
    atomic.make_folder(path.parent)
    atomic.write_bytes(path, data)


def _stamp(file: Path) -> Stamp:
    """Path, size in bytes, and modification time (nanoseconds) of the list and its images. Missing files are
    skipped."""
    tree = nerfstudio_fields.load_object(file)
    images = [file.parent / str(entry.get("file_path", "")).replace("\\", "/") for entry in tree["frames"]]
    found = [(path.absolute(), path.stat()) for path in (file, *images) if path.is_file()]
    return tuple((str(path), stat.st_size, stat.st_mtime_ns) for path, stat in found)
