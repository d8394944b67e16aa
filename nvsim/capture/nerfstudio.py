"""Read nerfstudio's transforms.json and its variants: instant-ngp's, and the split files of Blender and NeRF.

The split files transforms_train.json, transforms_val.json, and transforms_test.json are read as one capture.

Camera axes in the file are OpenGL's (x right, y up, z back); poses are camera-to-world. `applied_transform` records a
transform of the original data. The stored poses and the stored point cloud already agree, so it is not undone.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nvsim.capture import nerfstudio_fields
from nvsim.capture.findings import Findings
from nvsim.capture.moved_files import CLOUD_EXTENSIONS, IMAGE_EXTENSIONS, FolderFiles, report_moved
from nvsim.capture.nerfstudio_fields import (
    LENS_FIELDS,
    Tree,
    is_arbitrary,
    is_feature_cloud,
    is_instant_ngp,
    report_unused,
    unit_of,
)
from nvsim.capture.pointcloud import read_cloud
from nvsim.capture.raw import (
    LOST_FRAME,
    RawCapture,
    RawFrame,
    checked_pose,
    file_size,
    natural_order,
    read_lens,
    size_of_lens,
)
from nvsim.capture.types import Cloud, DepthFile, MaskFile
from nvsim.errors import InputError, value_text
from nvsim.files.reading import reading
from nvsim.geometry.lens import Lens

_OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_EXTENSIONS = (*IMAGE_EXTENSIONS, *(extension.upper() for extension in IMAGE_EXTENSIONS))
_KNOWN_ENDS = (*IMAGE_EXTENSIONS, *CLOUD_EXTENSIONS)
_SPLIT = ("transforms_train.json", "transforms_val.json", "transforms_test.json")
_PERSPECTIVE = {"OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "FULL_OPENCV", "PERSPECTIVE"}
_FISHEYE = {"OPENCV_FISHEYE", "FISHEYE"}


def find(path: Path) -> Path | None:
    """The argument for `read`, or None if there is no capture. A file may have any name that ends in .json.

    For a folder, it is its transforms.json; the folder itself if it has split files such as transforms_train.json; or
    the only file in it with a name like transforms_NAME.json."""
    if not path.is_dir():
        return path if path.suffix.lower() == ".json" else None
    if file_size(path / "transforms.json") is not None:
        return path / "transforms.json"
    if _split_files(path):
        return path
    named = _named_alike(path)
    return named[0] if len(named) == 1 else None


def explain_missing(folder: Path) -> str:
    """A sentence about a folder with several possible transforms files, of which none is read; "" otherwise."""
    named = _named_alike(folder)
    if len(named) > 1:
        names = ", ".join(value_text(path.name) for path in named[:5])
        return f"{value_text(folder)} has no transforms.json, but {names}; name the one to read."
    return ""


def _split_files(folder: Path) -> list[Path]:
    return [folder / name for name in _SPLIT if file_size(folder / name) is not None]


def _named_alike(folder: Path) -> list[Path]:
    """Files whose name resembles transforms.json, sorted."""
    try:
        names = sorted(name for name in os.listdir(folder) if re.fullmatch(r"(?i)transforms?([-_ .].*)?\.json", name))
    except OSError:
        return []
    return [folder / name for name in names if file_size(folder / name) is not None]


def read(path: Path, findings: Findings) -> RawCapture:
    """The capture of a transforms.json, or of a folder with split files such as transforms_train.json.

    Problems of a frame are added to `findings`. Raises InputError if the file as a whole cannot be read."""
    with reading(path, "a transforms.json"):
        if path.is_dir():
            return _read_split(path, findings)
        beside = [other.name for other in _split_files(path.parent) if other.name != path.name]
        if beside and path.name in ("transforms.json", *_SPLIT):
            findings.note(
                f"{', '.join(beside)} beside {path.name} is not read", path.name, "name it to read it instead"
            )
        return _read(path, findings)


def _read_split(folder: Path, findings: Findings) -> RawCapture:
    """The frames of all split files, without duplicates of image and pose. If no name occurs twice, the frames are
    sorted by name, which restores the order of a recording that was split into files."""
    raws = [_read(path, findings) for path in _split_files(folder)]
    frames: list[RawFrame] = []
    first: dict[str, RawFrame] = {}
    for raw in raws:
        for frame in raw.frames:
            same = first.setdefault(frame.name, frame)
            if same is frame or not _same_pose(same, frame):
                frames.append(frame)
    stems = [Path(frame.name).stem for frame in frames]
    if len(set(stems)) == len(stems):
        frames.sort(key=lambda frame: (natural_order(Path(frame.name).stem), frame.name))
    frames = [replace(frame, timestamp=float(i)) for i, frame in enumerate(frames)]
    counts = ", ".join(f"{raw.source.name} ({len(raw.frames)})" for raw in raws)
    findings.note(
        f"{counts} are read as one capture" if len(raws) > 1 else f"{counts} is read",
        folder.name,
        "--hold-out selects the held-out frames, not these files",
    )
    metric = next((raw for raw in raws if raw.metric), raws[0])
    cloud = next((raw.cloud for raw in raws if raw.cloud is not None), None)
    depths = tuple(depth for raw in raws for depth in raw.depths)
    return replace(metric, source=folder, frames=tuple(frames), cloud=cloud, depths=depths)


def _same_pose(a: RawFrame, b: RawFrame) -> bool:
    if a.camera_to_world is None or b.camera_to_world is None:
        return a.camera_to_world is b.camera_to_world
    return np.array_equal(a.camera_to_world, b.camera_to_world)


def _read(path: Path, findings: Findings) -> RawCapture:
    tree = nerfstudio_fields.load_object(path)
    frames = tree.get("frames")
    if not isinstance(frames, list):
        raise InputError(f"{path} has no list 'frames', so it is not a transforms.json; choose another file.")
    read, depths = [], []
    lenses: dict[str, Lens | None] = {}
    files = FolderFiles(path.parent)
    for i, entry in enumerate(frames):
        where = f"{path.name}, frame {i}"
        if not isinstance(entry, dict):
            findings.error("the frame is not a JSON object", where, LOST_FRAME)
            continue
        frame = _frame(path, tree, entry, i, where, lenses, files, findings)
        if frame is not None:
            read.append(frame)
            depths += _depth(path, tree, entry, frame, where, findings)
    entries = [f for f in frames if isinstance(f, dict)]
    if all("timestamp" in f for f in entries):
        read.sort(key=lambda f: f.timestamp)
    if is_instant_ngp(tree):
        read.sort(
            key=lambda f: natural_order(f.name)
        )  # instant-ngp's converter lists frames in the order of their registration
    report_unused(tree, entries, path.name, findings)
    cloud = _cloud(path, tree, entries, files, findings)
    from nvsim.capture.depth_images import with_unit_of_floats  # imports OpenCV, which slows down the start of the app

    metric, because = unit_of(tree, entries, cloud)
    kind = "instant-ngp" if is_instant_ngp(tree) else "nerfstudio"
    return RawCapture(path, kind, tuple(read), cloud, metric, (), tuple(with_unit_of_floats(depths)), because)


def _cloud(path: Path, tree: Tree, entries: Sequence[Tree], files: FolderFiles, findings: Findings) -> Cloud | None:
    """The point cloud that the file names. If it is missing, a warning is added, because images alone are usable."""
    where = f"{path.name}, ply_file_path"
    try:
        listed = nerfstudio_fields.text(tree, "ply_file_path", path.name)
        if listed is None:
            return None
        place = _resolve(path.parent, listed)
        found = place if os.path.lexists(place) else files.find(place)
        if found is None:
            findings.warning(
                f"the point cloud {value_text(listed)} is named in the file but missing",
                where,
                "the capture is used without a point cloud",
            )
            return None
        if found != place:
            report_moved("point cloud", {place: found}, path, findings)
        features = is_arbitrary(tree, entries) or is_feature_cloud(listed)
        return read_cloud(found, findings, kind="sfm" if features else "lidar")
    except InputError as error:
        findings.error(str(error).rstrip("."), where, "without it, the floor cannot be measured")
        return None


def _frame(
    path: Path,
    tree: Tree,
    entry: Tree,
    index: int,
    where: str,
    lenses: dict[str, Lens | None],
    files: FolderFiles,
    findings: Findings,
) -> RawFrame | None:
    try:
        listed = nerfstudio_fields.text(entry, "file_path", where)
        if listed is None:
            raise InputError(f"{where}: the field 'file_path' is missing; add it.")
        name = _name(listed)
        where = f"{where} ({name})"
        image = _resolve(path.parent, listed)
        lens = _lens(tree, entry, image, where, lenses, files, findings)
        pose = None
        if entry.get("transform_matrix") is None:
            findings.error("the frame has no pose (no field 'transform_matrix')", where, "the frame cannot be placed")
        else:
            pose = checked_pose(nerfstudio_fields.matrix(entry["transform_matrix"], where), where, findings)
        timestamp = nerfstudio_fields.number(entry, "timestamp", where)
    except InputError as error:
        findings.error(str(error).removeprefix(f"{where}: ").rstrip("."), where, LOST_FRAME)
        return None
    if pose is not None:
        pose = pose @ _OPENGL_TO_OPENCV
    at = float(index) if timestamp is None else timestamp
    mask = _mask(path, tree, entry, where, findings)
    return RawFrame(name, image, lens, pose, where, timestamp=at, axes="opengl", mask=mask)


def _mask(path: Path, tree: Tree, entry: Tree, where: str, findings: Findings) -> MaskFile | None:
    """The mask of a frame, or the shared mask of all frames; black is ignored."""
    try:
        listed = nerfstudio_fields.text({"mask_path": tree.get("mask_path"), **entry}, "mask_path", where)
    except InputError as error:
        findings.warning(str(error).removeprefix(f"{where}: ").rstrip("."), where, "the mask is not used")
        return None
    return None if listed is None else MaskFile(_resolve(path.parent, listed).absolute())


def _depth(
    path: Path, tree: Tree, entry: Tree, frame: RawFrame, where: str, findings: Findings
) -> list[DepthFile]:  # fmt: skip
    """The depth image of a frame, if it has one; it shares the frame's pose and lens. Values are in millimeters unless
    the frame or the file gives another unit."""
    try:
        listed = nerfstudio_fields.text(entry, "depth_file_path", where) or nerfstudio_fields.text(
            entry, "depth_path", where
        )
        both = {**tree, **entry}
        units = [
            nerfstudio_fields.number(both, key, where) for key in ("integer_depth_scale", "depth_unit_scale_factor")
        ]
        unit = next((u for u in units if u is not None), 0.001)
        if listed is not None and unit <= 0:
            raise InputError(f"{where}: the unit of the depth image, {unit:g}, is not positive.")
    except InputError as error:
        findings.warning(str(error).removeprefix(f"{where}: ").rstrip("."), where, "the frame has no depth image")
        return []
    if listed is None or frame.lens is None or frame.camera_to_world is None:
        return []
    file = _resolve(path.parent, listed)
    return [DepthFile(file, frame.lens, frame.camera_to_world, frame.name, unit=unit)]


def _name(listed: str) -> str:
    parts = [p for p in listed.replace("\\", "/").split("/") if p not in ("", ".")]
    return "/".join(parts) or listed


def _resolve(folder: Path, listed: str) -> Path:
    """The path of the file `listed`: as written, with forward slashes, or with an extension that older files omit."""
    candidates = [listed, listed.replace("\\", "/")]
    if not candidates[1].lower().endswith(_KNOWN_ENDS):
        candidates += [candidates[1] + extension for extension in _EXTENSIONS]
    for candidate in candidates:
        if file_size(folder / candidate) is not None:
            return folder / candidate
    return folder / candidates[1]


def _lens(
    tree: Tree,
    entry: Tree,
    image: Path,
    where: str,
    lenses: dict[str, Lens | None],
    files: FolderFiles,
    findings: Findings,
) -> Lens | None:
    """The frame's own camera, or the camera of the file. Equal cameras are one object, and a fault in one is reported
    once."""
    own = {key: entry[key] for key in LENS_FIELDS if key in entry}
    known = str(sorted(own.items()))
    if known not in lenses:
        place = where if own else where.split(",")[0]
        try:
            lenses[known] = _parse_lens({**tree, **own}, image, place, files, findings)
        except InputError as error:
            findings.error(str(error).removeprefix(f"{place}: ").rstrip("."), place, "no frame can use this camera")
            lenses[known] = None
    return lenses[known]


def _parse_lens(tree: Tree, image: Path, where: str, files: FolderFiles, findings: Findings) -> Lens | None:
    def get(key: str, default: float) -> float:
        value = nerfstudio_fields.number(tree, key, where)
        return default if value is None else value

    model = nerfstudio_fields.text(tree, "camera_model", where) or "OPENCV"
    if model == "EQUIRECTANGULAR":
        raise InputError(
            f"{where}: the images are panoramas of a 360 degree camera (EQUIRECTANGULAR), which must be split into "
            "perspective views first; `nvsim poses FILE --out FOLDER` makes a capture of them."
        )
    width, height = nerfstudio_fields.number(tree, "w", where), nerfstudio_fields.number(tree, "h", where)
    if width is None or height is None:
        from nvsim.capture.images import image_size

        width, height = image_size(files.find(image) or image)
        width, height = size_of_lens((width, height), (get("cx", width / 2), get("cy", height / 2)))
    fx = nerfstudio_fields.number(tree, "fl_x", where)
    if fx is None:
        angle = nerfstudio_fields.number(tree, "camera_angle_x", where)
        if angle is None or not 0 < angle < math.pi:
            raise InputError(f"{where}: there is neither 'fl_x' nor a 'camera_angle_x' between 0 and pi; add one.")
        fx = width / 2 / math.tan(angle / 2)
    vertical = nerfstudio_fields.number(tree, "camera_angle_y", where)
    by_angle = height / 2 / math.tan(vertical / 2) if vertical and 0 < vertical < math.pi and "fl_x" not in tree else fx
    pinhole = (fx, get("fl_y", by_angle), get("cx", width / 2), get("cy", height / 2))
    k = [get(f"k{i}", 0.0) for i in (1, 2, 3, 4)]
    p = [get("p1", 0.0), get("p2", 0.0)]
    if tree.get("distortion_params") is not None:  # in nerfstudio, this field overrides the single fields
        *k, p[0], p[1] = _distortion(tree["distortion_params"], where)
    fisheye = model in _FISHEYE or ("camera_model" not in tree and tree.get("is_fisheye") is True)
    if not fisheye and model not in _PERSPECTIVE:
        known = ", ".join(sorted(_PERSPECTIVE | _FISHEYE))
        raise InputError(f"{where}: camera model {model!r} is not supported (supported: {known}).")
    if fisheye:
        return read_lens("OPENCV_FISHEYE", width, height, (*pinhole, *k), where, findings)
    if k[3] != 0:
        raise InputError(f"{where}: 'k4' of a perspective camera is not supported; undistort the images first.")
    if k[2] != 0:
        return read_lens("FULL_OPENCV", width, height, (*pinhole, k[0], k[1], *p, k[2], 0, 0, 0), where, findings)
    if any(k) or any(p):
        return read_lens("OPENCV", width, height, (*pinhole, k[0], k[1], *p), where, findings)
    return read_lens("PINHOLE", width, height, pinhole, where, findings)


def _distortion(values: object, where: str) -> list[float]:
    """k1 to k4, p1, and p2 from the field distortion_params. Raises InputError unless it is a list of six numbers."""
    numbers = dict(enumerate(values)) if isinstance(values, list) and len(values) == 6 else {}
    found = [
        nerfstudio_fields.number({"distortion_params": numbers.get(i)}, "distortion_params", where) for i in range(6)
    ]
    if any(value is None for value in found):
        raise InputError(
            f"{where}: 'distortion_params' is not a list of six numbers (k1, k2, k3, k4, p1, p2); correct it."
        )
    return [value for value in found if value is not None]
